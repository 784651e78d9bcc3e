"""Learned functions: networks, their training and the data they are trained on."""
