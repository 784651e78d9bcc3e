"""Patience with robots of a busy machine."""

from contextlib import contextmanager

import pytest

from softrobot_env.hardware import driver


@contextmanager
def patient_drivers():
    """Drivers wait longer for an answer, and take no robot for dead that is only slow."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driver, "_FRESH", 10.0)
        for method in (driver.Driver.connect, driver.Driver.arm):
            patch.setattr(method, "__defaults__", (20.0,))
        yield
