"""Beam models that do not use MuJoCo: the independent truth and the controllers' models."""
