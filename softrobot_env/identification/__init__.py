"""From measurements of a rig to what its controllers know of it."""
