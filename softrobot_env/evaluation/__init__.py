"""Run policies, measure them as the thesis does, and report."""
