"""Laws, identification and models of the spatial test rig."""
