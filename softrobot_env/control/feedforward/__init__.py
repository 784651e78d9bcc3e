"""Laws for any robot, based on the inverse of its model along the reference."""
