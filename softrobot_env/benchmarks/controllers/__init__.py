"""What sec. 6.6 of the thesis reports about its controllers, run anew for all policies."""
