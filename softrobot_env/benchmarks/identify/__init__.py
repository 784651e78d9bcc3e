"""Study of identifications: robots of another model class, with truths that nobody is told."""
