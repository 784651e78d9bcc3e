"""Laws of any robot that begin with the inverse of its model along the reference."""
