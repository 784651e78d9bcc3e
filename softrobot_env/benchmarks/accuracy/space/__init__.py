"""Slender rods in space: wrenches in all directions, helices, circles and follower loads."""
