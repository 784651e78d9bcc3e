"""Policies: the thesis' controllers and their extensions, one per file."""
