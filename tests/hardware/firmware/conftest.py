"""Settings of the property tests."""

from hypothesis import HealthCheck, settings

# How long an example takes is no verdict: the machine may be busy.
settings.register_profile("busy", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")
