"""Policies of the spatial test rig."""
