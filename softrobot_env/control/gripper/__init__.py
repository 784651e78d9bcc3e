"""Policies of grippers, and the size of what they enclose."""
