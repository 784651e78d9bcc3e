"""`softrobot robot`."""
