"""Run policies, compute the metrics of the thesis, and report."""
