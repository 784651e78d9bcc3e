"""Exact solutions that every model is held to; none of them has a mesh."""
