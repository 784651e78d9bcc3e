"""Every field of every data class that users make refuses what it cannot hold, in one line."""

from dataclasses import dataclass, fields, replace
from math import inf, nan
from typing import Annotated

import numpy as np
import pytest

from softrobot_env.control.mpc.settings import PREVIEW as MPC_PREVIEW
from softrobot_env.control.mpc.settings import THESIS as MPC_THESIS
from softrobot_env.core.records import Range, check_fields
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.learned.quasi_static import Sampling
from softrobot_env.robots import ARM, RIG, Load
from softrobot_env.robots.twin import rig3d_twin
from softrobot_env.scene.config import Appearance, Camera, Marker, PathMarker, SceneConfig
from softrobot_env.tasks import SetPoints, make_task
from softrobot_env.tasks.rig_trajectories import LapCircle, RoundedTriangle
from softrobot_env.tasks.smooth_paths import SmoothRun, circle
from softrobot_env.tasks.trajectories import CurveSweep, EqualForceCurve, Polyline, Step

POINTS = ((0.1, 0.0, 0.4), (0.2, 0.0, 0.3))
CIRCLE = circle(*POINTS)

RECORDS = (
    ARM,
    RIG,
    ARM.tendons[0],
    RIG.head,
    Load("push", 0.1),
    rig3d_twin(0),
    SceneConfig(ARM),
    Camera("side", (0.0, 1.0), 1.0),
    Marker("target", POINTS[0]),
    PathMarker("path", POINTS),
    Appearance(),
    make_task("swing"),
    make_task("triangle"),
    Step(*POINTS),
    Polyline(POINTS, (0.0, 1.0)),
    EqualForceCurve(0.5),
    CurveSweep(EqualForceCurve(0.5), 0.5, 0.1),
    CIRCLE,
    SmoothRun(CIRCLE, 0.1),
    RoundedTriangle(),
    LapCircle(),
    SetPoints(POINTS, 1.0),
    TrackingReward(),
    Sampling(),
    MPC_THESIS,
    MPC_PREVIEW,
)

#: What no field may hold, but for the exceptions.
STRANGE = (nan, -inf, (nan,) * 2, (nan,) * 3, (1.0, inf), "", b"x", {}, object(), np.array(nan))

CASES = [(record, field.name) for record in RECORDS for field in fields(record)]


def refusal(record, name, value):
    """The message with which a value of a field is refused."""
    with pytest.raises(ValueError, match=name) as caught:
        replace(record, **{name: value})
    return str(caught.value)


@pytest.mark.parametrize(("record", "name"), CASES, ids=lambda x: getattr(x, "name", str(x))[:20])
def test_strange_values_are_refused_by_name(record, name):
    for value in STRANGE:
        message = refusal(record, name, value)
        assert "must be" in message and "\n" not in message and len(message) < 300


@pytest.mark.parametrize(("record", "name"), CASES, ids=lambda x: getattr(x, "name", str(x))[:20])
def test_numbers_are_no_texts_and_texts_no_numbers(record, name):
    """Nor are truth values numbers."""
    value = getattr(record, name)
    if name == "accuracy":
        replace(record, accuracy=1e-3)  # a length or a share as text
        refusal(record, name, True)
    elif isinstance(value, str):
        refusal(record, name, 1.0)
    elif isinstance(value, bool):
        refusal(record, name, 1)
    elif isinstance(value, int | float):
        refusal(record, name, str(value))
        refusal(record, name, True)
    elif isinstance(value, tuple) and value:
        refusal(record, name, value[0])
        refusal(record, name, (*value, "one more"))
        assert "[0]" in refusal(record, name, (None, *value[1:]))


@pytest.mark.parametrize(
    ("record", "changes"),
    [
        *((ARM, {"poisson_ratio": value}) for value in (0.6, -1.0, -2.0, 0.5000001)),
        *((ARM, {name: 0.0}) for name in ("length", "outer_radius", "youngs_modulus", "density")),
        *((ARM, {name: -1.0}) for name in ("inner_radius", "damping_time", "anisotropy")),
        *((ARM, {"pieces": value}) for value in (0, -1, 1.5, 6.0)),
        (ARM, {"gravity": (0.0, -9.81)}),
        (RIG, {"precurvature": (0.0, 0.0, 0.0)}),
        (ARM.tendons[0], {"stiffness": 0.0}),
        (ARM.tendons[0], {"tension_limit": inf}),
        (ARM.tendons[0], {"guides": (0.1, nan)}),
        (RIG.head, {"inertia": (1e-6, 1e-6)}),
        (RIG.head, {"output": -0.01}),
        (SceneConfig(ARM), {"pieces": 0}),
        (SceneConfig(ARM), {"torsion": 1}),
        (Load("push", 0.1), {"station": -0.1}),
        (Appearance(), {"link_rgba": (0.0, 0.0, 0.0, 1.5)}),
        (make_task("triangle"), {"axes": "yz"}),
        (make_task("triangle"), {"duration": 0.0}),
        (TrackingReward(), {"fine_scale": 0.0}),
    ],
    ids=str,
)
def test_what_is_not_physical_is_refused(record, changes):
    (name, value), *_ = changes.items()
    refusal(record, name, value)


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: replace(ARM, tendons=(ARM.tendons[0],) * 2), "tendons need different names"),
        (
            lambda: replace(ARM, outer_radius=1e-100, inner_radius=0.0),
            "bending_stiffness would be 0",
        ),
        (lambda: replace(ARM, outer_radius=1e200), "mass would be inf"),
        (lambda: replace(RIG.head, inertia=(1e-6, 1e-6, 3e-6)), "sum of the other two"),
        (
            lambda: SceneConfig(ARM, loads=(Load("a", 0.1), Load("a", 0.2))),
            "loads need different names, 'a'",
        ),
    ],
)
def test_what_does_not_go_together_is_refused(make, reason):
    with pytest.raises(ValueError, match=reason):
        make()


def test_lists_and_arrays_are_kept_as_tuples():
    """So that what is equal compares as equal."""
    for gravity in ([0, 0, -9.81], np.array([0, 0, -9.81])):
        assert replace(RIG, gravity=gravity) == RIG
    assert replace(ARM.tendons[0], guides=[0.05, 0.1]).guides == (0.05, 0.1)
    numbers = replace(ARM, length=np.float64(ARM.length), pieces=np.int64(6))
    assert numbers == ARM


@dataclass(frozen=True)
class Sample:
    choice: Annotated[float, Range("a share", lambda x: 0 <= x <= 1)] = 0.5
    either: tuple[int, str] | None = None
    many: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        check_fields(self, "sample")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"choice": 2}, "sample: choice must be a share, got 2"),
        ({"either": (1.5, "a")}, "either must be None or a tuple of 2, each a whole number or a"),
        ({"many": ((1.0,), (2.0, nan))}, "many[1][1] must be a finite number, got nan"),
        ({"many": (1.0,)}, "many[0] must be a tuple, each entry a finite number, got 1.0"),
        ({"many": "long " * 99}, "..."),
    ],
    ids=str,
)
def test_messages_name_the_place(change, message):
    with pytest.raises(ValueError) as caught:
        Sample(**change)
    assert message in str(caught.value) and len(str(caught.value)) < 250
    assert Sample(0, (1, "a"), [[1, 2], []]).many == ((1, 2), ())
