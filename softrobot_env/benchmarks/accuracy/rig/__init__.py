"""The accuracy benchmark of the spatial test rig."""
