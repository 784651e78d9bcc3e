"""Feedback of a late tip on the disturbed rig (thesis sec. 6.1), and what goes beyond."""
