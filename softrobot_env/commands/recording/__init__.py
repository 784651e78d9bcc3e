"""`softrobot recording` and its commands."""
