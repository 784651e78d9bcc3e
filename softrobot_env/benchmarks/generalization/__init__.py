"""All policies on references that they have not met, and on robots that they do not know."""
