"""Control on reduced models that were learned from recorded motion (`learned.reduction`)."""
