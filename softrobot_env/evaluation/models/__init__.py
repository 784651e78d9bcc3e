"""Accuracy and stability of the models of one robot."""
