"""What sec. 5.4 of the thesis reports about its controllers, run anew on twins of the rig."""
