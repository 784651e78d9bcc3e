"""Accuracy against cost, and speed."""
