"""Laws, networks and trainings of the planar arm in closed form."""
