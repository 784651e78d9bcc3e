"""Model predictive control of the planar arm."""
