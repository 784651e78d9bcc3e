"""The example robots, and all environments, as parameters of tests."""

import pytest

from softrobot_env.registration import ENVIRONMENTS as ARM
from softrobot_env.registration import RIG_ENVIRONMENTS as RIG
from softrobot_env.robots import EXAMPLES

#: Those whose statics and motion take long; what the others show too is left to `make slow`.
LONG = ("hanging_trunk", "ftdcr_v4")

#: The names, of which the long ones are slow.
SOME = [pytest.param(name, marks=pytest.mark.slow if name in LONG else ()) for name in EXAMPLES]

#: Every kind of simulated environment: ids, and the options that make the examples.
EVERY_ROBOT = pytest.mark.parametrize(
    ("env_id", "options"),
    [
        *(pytest.param(i, {}, id=i) for i in (*ARM, *RIG)),
        *(
            pytest.param(
                "SoftRobot/Track-v0",
                {"robot": name, "task": "reach"},
                id=name,
                marks=pytest.mark.slow if name in LONG else (),
            )
            for name in EXAMPLES
        ),
    ],
)
