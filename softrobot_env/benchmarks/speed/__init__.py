"""Environment steps per second, what a step costs, and how long policies decide."""
