"""Policies that are networks."""
