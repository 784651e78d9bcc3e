"""Models in closed form: equal pieces of constant curvature, in a plane or one in space."""
