"""`softrobot evaluate`."""
