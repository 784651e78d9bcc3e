"""Curvature sensors: how they follow a robot's shape, what light they pass, how they are read."""
