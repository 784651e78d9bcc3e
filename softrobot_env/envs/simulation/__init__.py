"""What environments advance: MuJoCo chains, single and in batches, beam models, servos."""
