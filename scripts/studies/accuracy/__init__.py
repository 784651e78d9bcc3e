"""Error against run time of all models, their agreement and goals."""
