"""Identification of a robot from a recording: unknowns, fits and their uncertainty."""
