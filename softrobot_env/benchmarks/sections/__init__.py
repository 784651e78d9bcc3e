"""Robots of sections and routed tendons against exact rods: error and run time."""
