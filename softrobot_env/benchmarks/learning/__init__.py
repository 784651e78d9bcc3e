"""Learning curves and figures of trained policies over several seeds."""
