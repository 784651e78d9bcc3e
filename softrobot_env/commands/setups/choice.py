"""The robots that commands can be given."""

import argparse

from softrobot_env.commands.setups.arm import ArmSetup
from softrobot_env.commands.setups.base import Setup
from softrobot_env.commands.setups.rig import RigSetup
from softrobot_env.evaluation.labels import REAL, VIRTUAL

#: What --env can be: simulated, or over a serial line.
SIMULATED = "sim"
ENVIRONMENTS = (SIMULATED, VIRTUAL, REAL)

#: Arguments that only robots over a serial line have.
SERIAL = ("robot_file", "port", "record")


def make_setups(args: argparse.Namespace) -> tuple[Setup, ...]:
    """One setup for every kind of robot.

    Each task belongs to one of them.

    Raises:
        ValueError: Arguments of a robot over a serial line for a simulated one.
        ImportError: Packages of the extra `robot` are missing.
    """
    if getattr(args, "env", SIMULATED) != SIMULATED:
        from softrobot_env.commands.setups.real import RealSetup

        return ArmSetup(args), RealSetup(args)
    given = [f"--{name.replace('_', '-')}" for name in SERIAL if getattr(args, name, None)]
    if given:
        raise ValueError(f"{', '.join(given)}: only with --env real or virtual")
    return ArmSetup(args), RigSetup(args)
