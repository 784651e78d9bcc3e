"""What environments and their `reset` refuse: in one line that names what is allowed."""

from dataclasses import replace
from functools import cache, partial
from math import inf, nan

import gymnasium
import numpy as np
import pytest
from support.rig_episodes import flatten

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.control.gripper import columns
from softrobot_env.envs.gripper import GripperEnv, GripReward, VectorGripperEnv
from softrobot_env.envs.observations.table import known_of
from softrobot_env.envs.options import REAL_OPTIONS, SIMULATED_OPTIONS, parse_options
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.real import RealRigEnv
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.hardware.robot_file import rig_file
from softrobot_env.robots import ARM, GRIPPERS, RIG
from softrobot_env.robots.twin import Twin, rig3d_twin
from softrobot_env.robots.variations import VARIATIONS
from softrobot_env.tasks import make_task
from softrobot_env.tasks.gripper import GripTask
from softrobot_env.thesis.envs import RigEnv

STRANGE = (nan, -inf, -1.0, "x", (nan, 1.0), {}, object(), np.array(nan), np.array([nan, 1.0]))
TRIANGLE = make_task("triangle")
HASTY = replace(rig_file(), watchdog=0.1, ttl=0.1)
L_SHAPE = make_task("lshape")
RUBBING = replace(L_SHAPE, robot=ARM.vary(tendon_friction=0.1))
FAR, FAST = (
    replace(L_SHAPE, trajectory=replace(L_SHAPE.trajectory, **change))
    for change in ({"waypoints": ((0.0, 0.0, 0.6),) * 3}, {"times": (0.0, 0.01, 0.02)})
)
SENSED = ("tip_position", "reference", "sensors")
BLIND = rig3d_twin(0)
BLIND = replace(BLIND, robot=replace(BLIND.robot, sensors=()))
GRIPPER = GRIPPERS["gripper"]
BARE = replace(
    GRIPPER,
    fingers=tuple(replace(f, robot=replace(f.robot, sensors=())) for f in GRIPPER.fingers),
)

# ---------------------------------------------------------------- arguments


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        pytest.param(kind, name, id=f"{kind.__name__}-{name}")
        for kind in (TrackingEnv, RigEnv, VectorTrackingEnv, RealRigEnv)
        for name in kind.takes
    ],
)
def test_strange_arguments_are_refused_by_name(kind, name):
    for value in STRANGE:
        if name == "port" and isinstance(value, str):
            continue  # as it may be
        # What is no name of a task or a file is refused by what was given.
        message = f"{name}|x" if name in ("task", "robot_file") else name
        with pytest.raises((ValueError, FileNotFoundError), match=message) as caught:
            kind(**{name: value})
        assert "\n" not in str(caught.value)


OBSERVABLES = ", ".join(known_of(ARM))
PERIOD = r"control_period must be .*between 0\.001 and 0\.2 s"

#: (environment, arguments, what the message says)
ARGUMENTS = [
    *((TrackingEnv, {"control_period": x}, PERIOD) for x in (0.0, 0.9e-3, 0.21, -0.01, nan, inf)),
    *((RigEnv, {"control_period": x}, PERIOD) for x in (0.5, None, "x")),
    *((TrackingEnv, {"preview": x}, "preview") for x in ((), (-0.1,), (0.1, nan), (inf,), 0.1)),
    *(
        (TrackingEnv, {"observe": x}, OBSERVABLES)
        for x in ((), ("tip",), ("reference", "tip"), ("reference", "reference"), "tip", "")
    ),
    (TrackingEnv, {"timestep": 0.03, "control_period": 0.02}, "timestep must be at most the con"),
    (TrackingEnv, {"task": "wave"}, "swing"),
    (TrackingEnv, {"render_mode": "ansi"}, "'rgb_array', 'human'"),
    (TrackingEnv, {"width": 0}, "width must be a whole number from 1 to 8192"),
    (TrackingEnv, {"height": 320.5}, "height must be a whole number from 1 to 8192"),
    (TrackingEnv, {"pieces": 4}, "inside a piece"),
    (BeamPlant, {"name": "fem"}, "pcc, cosserat, ancf"),
    *(
        (TrackingEnv, {"plant": BeamPlant("pcc"), name: value}, f"{name} belong")
        for name, value in (("pieces", 3), ("rule", "midpoint"), ("integrator", "RK4"))
    ),
    (TrackingEnv, {"robot": "hanging_trunk", "task": "circle", "twin": 1}, "driven by tension"),
    (TrackingEnv, {"robot": "snake"}, "unknown robot 'snake'; choose from .*arm"),
    (TrackingEnv, {"robot": "silicone_rod"}, "unknown task 'swing'; choose from reach"),
    (TrackingEnv, {"robot": "arm", "task": make_task("swing")}, "made already has its robot"),
    (TrackingEnv, {"task": FAR}, "reference of task 'lshape'"),
    (TrackingEnv, {"task": FAST}, r"below 5\.0 m/s"),
    (TrackingEnv, {"task": RUBBING, "plant": BeamPlant("pcc")}, "have no tendon friction"),
    (TrackingEnv, {"task": "step", "observe": SENSED}, "distinct names out of tip_position"),
    (TrackingEnv, {"randomization": Randomization(sensor_errors=(0.0, 1.0))}, "'arm' has none"),
    (TrackingEnv, {"task": "rig_circle", "twin": BLIND}, "a twin needs sensors of the same kinds"),
    *(
        (kind, {name: value}, f"{name} must be .*{allowed}")
        for kind in (TrackingEnv, VectorTrackingEnv)
        for name, value, allowed in (
            ("observe_as", "list", "'dict', 'vector'"),
            ("act_as", "rate", "'input', 'change'"),
            ("reward", "sparse", "'tracking', 'log'"),
        )
    ),
    (VectorTrackingEnv, {"num_envs": 0}, "num_envs must be a whole number, 1 or more"),
    (VectorTrackingEnv, {"backend": "jax"}, "backend must be one of 'mujoco', 'warp'"),
    (VectorTrackingEnv, {"render_mode": "rgb_array"}, "render_mode must be None"),
    (VectorTrackingEnv, {"device": "cpu"}, "device 'cpu' is for backend='warp'"),
    (RigEnv, {"task": "swing"}, "choose from .*triangle, rig_circle"),
    (RigEnv, {"randomization": Randomization(tension_gain=(0.9, 1.1))}, "driven by length"),
    (RigEnv, {"period": 0.0}, "period must be finite and positive"),
    (RigEnv, {"radius": 0.1}, "no option 'radius'; it has period"),
    (RigEnv, {"task": make_task("reach"), "seed": 2}, "made already has its .*, got seed"),
    (RigEnv, {"period": 0.02}, "must accelerate by less|below"),
    (RigEnv, {"twin": -1}, "seed of a twin"),
    (RigEnv, {"observe": ("tip",)}, "curvature_rate"),
    (RigEnv, {"twin": Twin(replace(RIG, tendons=()), 1.0, (), ())}, "0 tendons"),
    (RealRigEnv, {"observe": ("curvature",)}, "distinct names out of tip_position"),
    (RealRigEnv, {"task": replace(TRIANGLE, start_input=(0.001, 0, 0))}, "start with all tendons"),
    (VectorGripperEnv, {"backend": "warp"}, "grippers have the backend 'mujoco'"),
    (GripperEnv, {"task": "throw"}, "choose from enclose, hold"),
    (GripperEnv, {"fineness": "exact"}, "choose from rule, quick"),
    (GripperEnv, {"fineness": 3}, "fineness must be"),
    (GripperEnv, {"gripper": "hand"}, "choose from gripper"),
    (GripperEnv, {"observe": ("curvature", "smell")}, "distinct names out of curvature"),
    (GripperEnv, {"observe_as": "image"}, "'dict', 'vector'"),
    (GripperEnv, {"pieces": 7}, "multiple of 3 pieces"),
    (GripperEnv, {"control_period": 0.0}, PERIOD),
    (
        GripperEnv,
        {"gripper": BARE, "observe": ("curvature", "sensors")},
        "finger 'left' carries no sensors",
    ),
    (columns, {"gripper": BARE}, "carry no planar sensors"),
    (GripTask, {"name": "x", "free": True, "diameter": (0.1, 0.05)}, "diameter must be a pair"),
    (GripTask, {"name": "x", "free": True, "closing": 3.0}, "closing must be less"),
    (GripReward, {"grip": nan}, "grip must be"),
    *(
        (Randomization, {name: ends}, "low <= high")
        for name in ("density", "tension_gain")
        for ends in ((0.0, 1.0), (2.0, 1.0), (1.0,), "wide", (1.0, inf))
    ),
    *(
        (Randomization, {name: ends}, "0 <= low <= high")
        for name in ("tendon_friction", "delay", "sensor_noise")
        for ends in ((-0.1, 0.1), (0.2, 0.1), (0.1,), "wide", (0.0, nan))
    ),
    (Randomization, {"delay": (0.0, 1.5)}, r"'delay' .* high <= 1,"),
    (Randomization, {"sensor_noise": (0.0, 11.0)}, r"'sensor_noise' .* high <= 10,"),
    *((RealRigEnv, {"oldest": x}, "oldest") for x in (nan, -0.1, inf)),
    *((RealRigEnv, {"max_missed": x}, "max_missed") for x in (-1, 2.5, True)),
    (RealRigEnv, {"control_period": 0.012}, "control_period"),
    (RealRigEnv, {"robot_file": HASTY, "control_period": 0.06}, "half of the watchdog"),
]


@pytest.mark.parametrize(("kind", "arguments", "message"), ARGUMENTS)
def test_bad_arguments_are_refused(kind, arguments, message):
    with pytest.raises(ValueError, match=message) as caught:
        kind(**arguments)
    assert "\n" not in str(caught.value)


# ---------------------------------------------------------------- options of a reset


@pytest.mark.parametrize("kind", [TrackingEnv, VectorTrackingEnv])
@pytest.mark.parametrize("name", VARIATIONS)
def test_variations_of_no_robot_are_refused(kind, name):
    low, _ = VARIATIONS[name].range
    for value in (nan, inf, -1.0, 1e300, "x", None, True, *((0.0, 1e-300) if low > 0 else ())):
        with pytest.raises(ValueError, match=f"value of '{name}' must be a number from {low:g} to"):
            made(kind).reset(options={"vary": {name: value}})


@cache
def made(kind):
    """An environment, at the start of an episode."""
    options = {"num_envs": 4} if kind is VectorTrackingEnv else {}
    if kind is TrackingEnv:
        options = {"task": "step"}
    env = kind(**options)
    env.reset(seed=0)
    return env


ONE, MANY, ROUND = TrackingEnv, VectorTrackingEnv, RigEnv
BEAM = partial(TrackingEnv, plant=BeamPlant("pcc"))
EVEN = partial(VectorTrackingEnv, 4, integrator="implicitfast")
STIFF = {"youngs_modulus": 100.0, "damping_time": [1.0, 0.01, 1.0, 1.0]}

#: (environment, options, what the message says)
OPTIONS = [
    *((kind, bad, "options must be") for kind in (ONE, MANY, ROUND) for bad in (nan, "x", (1.0,))),
    *((kind, {"vary": {1: 2}}, "must be a dict of numbers") for kind in (ONE, MANY)),
    (ONE, {"damping": 2.0}, f"unknown reset option 'damping'.*{'.*'.join(SIMULATED_OPTIONS)}"),
    (ONE, {"vary": {"length": 2.0}}, "youngs_modulus, density, damping_time, .*, sensor_noise"),
    (ONE, {"vary": {"delay": 0.015}}, r"multiple of the control period, 0\.01 s"),
    (ONE, {"vary": {"delay": 1.01}}, "'delay' must be a number from 0 to 1 s"),
    (ONE, {"vary": {"sensor_noise": 10.1}}, "'sensor_noise' must be a number from 0 to 10"),
    *((ONE, {"vary": x}, "vary") for x in (2.0, None)),
    *(
        (ONE, {"start_input": x}, "start_input")
        for x in ([1.0, 2.0], [1.0, nan, 2.0], [80.1, 0.0, 0.0], 5.0, "high", {"pair1": 1.0})
    ),
    *(
        (ONE, {"start_curvature": x}, "start_curvature")
        for x in ([1.0] * 5, [1.0] * 5 + [inf], [1.0] * 5 + [-40.1])
    ),
    (ONE, {"start_curvature": [0.0] * 6, "start_input": [0.0] * 3}, "not both"),
    *((ONE, {"step_width": x}, "step.width") for x in (0.0, 0.5, nan, "wide", [0.1])),
    *((ONE, {"duration": x}, "duration") for x in (0.0, -1.0, nan, inf, "long", None)),
    # Nothing is changed before the last value was looked at.
    *(
        (kind, {"vary": {"youngs_modulus": 2.0, "tension_gain": 0.5}, name: value}, message)
        for kind in (ONE, MANY)
        for name, value, message in (
            ("start_curvature", [50.0] * 6, "start_curvature"),
            ("start_input", [90.0, 0.0, 0.0], "start_input"),
            ("step_width", 3.0 if kind is ONE else 0.1, "step.width"),
            ("duration", 1e6, "'duration' must be at most"),
        )
    ),
    *(
        (MANY, {"vary": x}, y)
        for x, y in (
            (None, "must be a dict"),
            ({"speed": [1.0, 2.0, 3.0]}, "cannot vary 'speed'"),
            ({"density": "abc"}, "value of 'density'"),
            ({"density": [1.0, 2.0]}, "must be a number or 4"),
        )
    ),
    (MANY, {"reset_mask": np.ones(3, bool)}, "4 truth values"),
    (MANY, {"reset_mask": np.zeros(4, bool)}, "some of them true"),
    (MANY, {"vary": {"density": np.ones(3)}}, "a number or 4"),
    (MANY, {"vary": {"mass": 2.0}}, "choose from"),
    (MANY, {"vary": {"delay": [0.0, 0.01, 0.005, 0.0]}}, "multiple of the control period"),
    (MANY, {"vary": {"tendon_friction": [0.0, 1.0, -1.0, 0.0]}}, "tendon_friction"),
    (EVEN, {"vary": STIFF}, "robot 1 needs a timestep of .* with implicitfast"),
    (BEAM, {"vary": {"tendon_friction": 0.1}}, "beam models have no tendon friction"),
    (ONE, {"vary": {"sensor_errors": 1.0}}, "varies curvature sensors; robot 'arm'"),
    (MANY, {"step_width": 0.1}, "no option 'step_width'"),
    (MANY, {"speed": 1.0}, "unknown reset option"),
    (ROUND, {"clear_fault": True}, "unknown reset option 'clear_fault'; allowed are vary"),
    (ROUND, {"vary": {"tension_gain": 0.9}}, "robot 'rig' is driven by length"),
    (ROUND, {"duration": 0}, "'duration' must be a positive number"),
    (ROUND, {"duration": 1e6}, "at most 3600 s"),
    (ROUND, {"start_length": [0.0, 0.0]}, "3 finite numbers"),
    (ROUND, {"start_length": [0.0, 0.0, 0.04]}, r"lie between \[-0.03, -0.03, -0.03\] and .* m"),
    (ROUND, {"task": 3}, "'task' must be a dict"),
    (ROUND, {"task": {1: 2}}, "must be a dict of numbers"),
    (ROUND, {"task": {"radius": 0.1}}, "it has period"),
    (ROUND, {"task": {"name": 1.0}}, "no option 'name'"),
    (GripperEnv, {"size": 0.06}, "unknown option 'size'; allowed are diameter"),
    (GripperEnv, {"diameter": -0.06}, "'diameter' must be finite and positive"),
    (GripperEnv, {"pull": "much"}, "'pull' must be finite"),
    (GripperEnv, {"mass": [0.1, 0.1]}, "one number or one for each of 1"),
]


@pytest.mark.parametrize(("kind", "options", "message"), OPTIONS)
def test_bad_options_are_refused(kind, options, message):
    with pytest.raises(ValueError, match=message) as caught:
        made(kind).reset(options=options)
    assert "\n" not in str(caught.value)


def bad_actions(shape):
    """What no action of a shape may be."""
    size = int(np.prod(shape))
    for entry in (nan, inf, -inf, 1.0001, -1.0001, 1 + 1.1e-6):
        yield np.append(np.zeros(size - 1), entry).reshape(shape)
    for rows in ((*shape[:-1], 2), (*shape[:-1], 4), (0,), (1, *shape), (*shape, 1), ()):
        yield np.zeros(rows, np.float32)
    for entry, dtype in ((None, object), ("0", str), (0.0, complex)):
        yield np.full(shape, entry, dtype)
    yield from (np.full(shape, nan).tolist(), [0.0, [1.0, 0.0], 0.0], [[0, 0, 0], [0]], 0.0, None)


@pytest.mark.parametrize("kind", [ONE, MANY, ROUND, GripperEnv])
def test_refused_options_and_actions_change_nothing(kind):
    own = [made.__wrapped__(kind), made.__wrapped__(kind)]
    for other, options, message in OPTIONS:
        if other is kind:
            with pytest.raises(ValueError, match=message):
                own[0].reset(options=options)
    shape = own[0].action_space.shape
    with pytest.raises(gymnasium.error.ResetNeeded):
        kind().step(np.zeros(kind().action_space.shape))
    for bad in bad_actions(shape):
        numbers = rf"{' x '.join(map(str, shape))} numbers in \[-1, 1\]"
        with pytest.raises(ValueError, match=numbers) as caught:
            own[0].step(bad)
        assert "\n" not in str(caught.value)
    action = np.full(shape, 0.1, np.float32)
    for _ in range(3):
        assert flatten(own[0].step(action)) == flatten(own[1].step(action))


@pytest.mark.parametrize("given", [1, "yes", None])
def test_clear_fault_is_true_or_false(given):
    with pytest.raises(ValueError, match="clear_fault"):
        parse_options({"clear_fault": given}, REAL_OPTIONS)
