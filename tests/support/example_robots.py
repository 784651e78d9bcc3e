"""The example robots as parameters of tests."""

import pytest

from softrobot_env.robots import EXAMPLES

#: Those whose statics and motion take long; what the others show too is left to `make slow`.
LONG = ("hanging_trunk", "ftdcr_v4")

#: The names, of which the long ones are slow.
SOME = [pytest.param(name, marks=pytest.mark.slow if name in LONG else ()) for name in EXAMPLES]
