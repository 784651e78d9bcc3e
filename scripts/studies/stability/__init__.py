"""Which timestep, integrator, stiffness and damping hold."""
