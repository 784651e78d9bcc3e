"""Videos and plots of episodes."""
