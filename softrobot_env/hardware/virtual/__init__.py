"""A virtual robot: the firmware's own program in this process."""
