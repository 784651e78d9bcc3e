"""Accuracy, stability and speed of the simulation, always together with its cost."""
