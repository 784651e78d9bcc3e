"""Quasi-static networks of the spatial rig: size, samples and cost."""
