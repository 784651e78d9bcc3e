"""Policies of the planar arm."""
