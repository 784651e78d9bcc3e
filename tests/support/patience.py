"""Patience with robots of a busy machine."""

from contextlib import contextmanager
from dataclasses import replace

import pytest

from softrobot_env.commands.robot import soak, virtual
from softrobot_env.commands.robot.virtual import virtual_process
from softrobot_env.envs.real import RealRigEnv
from softrobot_env.hardware import driver, interface


@contextmanager
def patient_drivers():
    """Drivers wait longer for an answer, and take no robot for dead that is only slow."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(interface, "FRESH", 10.0)
        for method in (driver.Driver.connect, driver.Driver.arm):
            patch.setattr(method, "__defaults__", (20.0,))
        yield


@contextmanager
def patient_commands():
    """Commands' virtual robots and their environments wait as well."""

    @contextmanager
    def process(*args, **options):
        with virtual_process(*args, **options) as robot:
            yield robot._replace(file=replace(robot.file, watchdog=1.0, ttl=0.9))

    with patient_drivers(), pytest.MonkeyPatch.context() as patch:
        for module in (virtual, soak):
            patch.setattr(module, "virtual_process", process)
        patch.setitem(RealRigEnv.usual, "max_missed", 10_000)
        patch.setitem(RealRigEnv.usual, "oldest", 2.0)
        yield
