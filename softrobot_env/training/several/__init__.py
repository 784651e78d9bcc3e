"""Several runs of a training, over seeds and settings, and the search for settings."""
