"""Curvature sensors as chapter 4 of the thesis judges them, and a better estimate of the tip."""
