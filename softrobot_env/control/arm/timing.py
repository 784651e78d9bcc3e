"""When the LQ laws of the arm decide, and at which times they see the reference."""

#: [s] between decisions of a law.
PERIOD = 1e-3

#: Times [s] ahead at which `lq_preview` uses the reference; straight lines in between.
KNOTS = (0.001, 0.002, 0.004, 0.007, 0.011, 0.016, 0.023, 0.032, 0.045, 0.06, 0.08, 0.105, 0.15)

#: Keyword arguments of the environment that `lq_preview` needs.
ENVIRONMENT = {"control_period": PERIOD, "preview": KNOTS}
