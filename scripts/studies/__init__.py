"""Studies of this package, for a checkout: not in the wheel."""
