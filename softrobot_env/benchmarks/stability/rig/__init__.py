"""The stability benchmark of the spatial test rig."""
