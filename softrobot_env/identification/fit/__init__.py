"""A robot identified from a recording: what is unknown, found, and how well it is known."""
