"""Metrics and tables of the thesis' chapter 2 anew."""
