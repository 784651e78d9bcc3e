"""Videos and plots."""
