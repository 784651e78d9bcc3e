"""Reduced models of the rig, learned from its motion, beside the thesis' (sec. 3.3.3)."""
