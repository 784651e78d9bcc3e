"""Training of learned policies: imitation of a controller, and reinforcement learning."""
