"""Environment steps per second, and what a step costs."""
