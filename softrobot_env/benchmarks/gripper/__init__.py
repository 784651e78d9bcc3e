"""The gripper: its grips, the size of what it encloses, holds under pulls, and what they cost."""
