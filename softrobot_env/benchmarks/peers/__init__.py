"""Error and computing time beside SoRoMoX, and environment steps beside gym-softrobot."""
