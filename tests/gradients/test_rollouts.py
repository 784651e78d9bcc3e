"""Derivatives of motions and equilibria, against differences of the same runs, and each other."""

import pickle
import subprocess
import sys
from copy import deepcopy
from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from softrobot_env.core.motion import State
from softrobot_env.gradients import Rollout
from softrobot_env.gradients import tape as tapes
from softrobot_env.gradients.parameters import parameter
from softrobot_env.gradients.tracking import follow
from softrobot_env.robots import Drive, find_robot
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.integration import layout
from softrobot_env.scene.registry import scene_of
from studies.truths.moving_robots import moving

# Robots that begin anywhere, at any velocity of their fast modes.
pytestmark = pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")

#: Steps as long as asked for whatever their errors, so that those of two runs are alike.
ALIKE = {"accuracy": 1e4, "timestep": 2e-3}


def drawn(observed, seed=0):
    """Weights of all that is observed."""
    rng = np.random.default_rng(seed)
    return {k: rng.normal(size=x.shape) for k, x in observed._asdict().items()}


def weighed(weights, observed):
    return sum(float((weights[k] * getattr(observed, k)).sum()) for k in weights)


def difference(function, step):
    """Richardson's extrapolated central difference at 0, and what is left of its error."""
    entries = []
    for k in range(3):
        h = step / 2**k
        entry = (function(h) - function(-h)) / (2 * h)
        for j, before in enumerate(entries):
            entries[j], entry = entry, entry + (entry - before) / (4 ** (j + 1) - 1)
        entries.append(entry)
    return entry, abs(entries[-1] - entries[-2])


def close(found, wanted, share, scale=0.0):
    return abs(found - wanted) <= share * max(abs(found), abs(wanted), scale)


@pytest.mark.parametrize("seed", range(15))
def test_backwards_and_forwards_agree(seed):
    robot = moving(seed)
    rollout = Rollout(robot.scene, robot.parameters)
    motion = rollout.run(robot.inputs, State(robot.position, robot.velocity))
    weights, rng = drawn(motion.observed), np.random.default_rng(seed)
    found = motion.vjp(**weights)
    start = State(*rng.normal(size=(2, len(robot.position))))
    inputs = rng.normal(size=robot.inputs.shape)
    one = weighed(weights, motion.jvp(start=start, inputs=inputs))
    parts = found.position @ start.q, found.velocity @ start.v, (found.inputs * inputs).sum()
    # Opposite tendons that stick hold the same joints, and share it by what gives way: by 1e-9.
    opposite = len(rollout.plan.zones) and robot.scene.config.bending == "planar"
    share = 1e-7 if opposite else 1e-10
    assert close(one, sum(parts), share, max(map(abs, parts)))
    config = robot.scene.config
    scales = {name: parameter(config.robot, name).scale for name in robot.parameters}
    largest = max(abs(scales[name] * value) for name, value in found.parameters.items())
    for name, value in found.parameters.items():
        along = weighed(weights, motion.jvp(parameters={name: scales[name]}))
        assert close(along, scales[name] * value, share, largest), name


@pytest.mark.parametrize(
    "seed",
    [0, 1, 8, 3, 17, *(pytest.param(k, marks=pytest.mark.slow) for k in (6, 16, 18, 20, 22, 32))],
)
def test_derivatives_are_those_of_runs(seed):
    """Of runs of the simulation itself, with other inputs, starts and robots."""
    robot = moving(seed, **ALIKE)
    start = State(robot.position, robot.velocity)
    rollout = Rollout(robot.scene, robot.parameters)
    motion = rollout.run(robot.inputs, start)
    weights, rng = drawn(motion.observed, 1), np.random.default_rng(seed)
    found = motion.vjp(**weights)

    def run(other, inputs, state):
        again = other.run(inputs, state)
        assert np.array_equal(again._tape[:, :4], motion._tape[:, :4])
        return weighed(weights, again.observed)

    way, change = rng.normal(size=(2, len(start.q))), rng.normal(size=robot.inputs.shape)
    change *= np.abs(robot.inputs).max(axis=0)
    cases = {
        "start": (
            lambda e: run(rollout, robot.inputs, State(start.q + e * way[0], start.v + e * way[1])),
            found.position @ way[0] + found.velocity @ way[1],
        ),
        "inputs": (
            lambda e: run(rollout, robot.inputs + 0.1 * e * change, start),
            0.1 * (found.inputs * change).sum(),
        ),
    }
    for name in robot.parameters:
        one = parameter(robot.scene.config.robot, name)

        def varied(e, one=one):
            other = one.apply(robot.scene.config.robot, one.value + e * one.scale)
            scene = build_scene(replace(robot.scene.config, robot=other))
            return run(Rollout(scene), robot.inputs, start)

        cases[name] = varied, one.scale * found.parameters[name]
    # Where many zones may change their law differences are shorter, and rounding is more of them.
    step, scale = (1e-5, 1e-2) if len(rollout.plan.zones) else (1e-3, 1e-4)
    largest = max(abs(wanted) for _, wanted in cases.values())
    for name, (function, wanted) in cases.items():
        truth, error = difference(function, step)
        assert error < 1e-6 * largest, name
        assert close(wanted, truth, 1e-6, scale * largest), name


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("arm", {}),
        ("silicone_rod", {}),
        ("hanging_trunk", {}),
        ("hanging_trunk", {"friction_coefficient": 0.15}),
        ("ftdcr_v4", {}),
    ],
)
def test_steps_are_those_of_the_integrator(name, changed):
    """What is derived is what the simulation computed."""
    scene = build_scene(scene_of(find_robot(name).vary(**changed)))
    rollout, (low, high) = Rollout(scene), scene.model.actuator_ctrlrange.T
    inputs = np.random.default_rng(0).uniform(low, high, (20, len(low))) * 0.1
    motion = rollout.run(np.clip(inputs, low, high))
    states = np.zeros((len(motion._tape) + 1, 2, scene.model.nv), complex)
    chain = rollout.plan, rollout.values, *rollout.complex_track
    tapes.follow(*chain, motion._tape, motion._ramps, motion._slides[0], states)
    for number, seen in enumerate((motion.observed.position, motion.observed.velocity)):
        found = states[motion._ends[1:], number].real
        np.testing.assert_allclose(found, seen[1:], atol=1e-10 * np.ptp(seen))
    wanted = motion._tape[1:, layout.INTERVAL :][:, : 2 * scene.model.nv]
    found = states[1:-1].real.reshape(wanted.shape)
    np.testing.assert_allclose(found, wanted, atol=1e-10 * np.ptp(wanted))


@pytest.mark.parametrize("seed", [0, 1, 2, 7, 11])
def test_equilibria(seed):
    robot = moving(seed)
    rollout, u = Rollout(robot.scene, robot.parameters), np.abs(robot.inputs[0])
    rest = rollout.rest(u)
    weights = drawn(rest.observed)
    del weights["velocity"], weights["tip_velocity"]
    by_controls, by_parameters = rest.vjp(**weights)
    way = np.random.default_rng(seed).normal(size=len(u)) * u

    def held(other, controls):
        return weighed(weights, other.rest(controls, rest.observed.position[0]).observed)

    truth, _ = difference(lambda e: held(rollout, u + e * way), 1e-3)
    assert close(by_controls @ way, truth, 1e-6)
    largest = max(map(abs, by_parameters.values()))
    for name, wanted in by_parameters.items():
        one = parameter(robot.scene.config.robot, name)

        def varied(e, one=one):
            other = one.apply(robot.scene.config.robot, one.value + e * one.scale)
            return held(Rollout(build_scene(replace(robot.scene.config, robot=other))), u)

        truth, _ = difference(varied, 1e-3)
        assert close(one.scale * wanted, truth, 1e-6, 1e-2 * largest), name


@pytest.mark.parametrize("robot", [None, "silicone_rod"])
def test_environments(robot):
    """Actions of an environment, which servos may wind up; its own motion is the same."""
    options = {} if robot is None else {"robot": find_robot(robot), "task": "reach"}
    env = gymnasium.make(
        "SoftRobot/ArmSwing-v0" if robot is None else "SoftRobot/Track-v0", **options
    )
    rollout = Rollout.of(env, ["youngs_modulus", "tendon_radius"])
    rng = np.random.default_rng(3)
    actions = np.repeat(rng.uniform(-0.3, 0.3, (4, *env.action_space.shape)), 5, axis=0)
    actions = actions.astype(np.float32).astype(float)
    motion = rollout.run(actions)
    env.reset()
    for action in actions:
        env.step(action)
    np.testing.assert_array_equal(env.unwrapped.data.qpos, motion.observed.position[-1])
    weights, way = drawn(motion.observed), rng.normal(size=actions.shape)
    found, along = motion.vjp(**weights), motion.jvp(inputs=way)
    wanted = (found.inputs * way).sum()
    assert close(weighed(weights, along), wanted, 1e-10, np.abs(found.inputs * way).sum())
    h = 1e-6
    ends = [weighed(weights, rollout.run(actions + e * way).observed) for e in (h, -h)]
    assert close((ends[0] - ends[1]) / (2 * h), wanted, 1e-4 if robot else 1e-6)


def test_a_start_at_rest_moves_with_parameters():
    """The equilibrium in which an episode begins is one of the robot as it is then."""
    env = gymnasium.make("SoftRobot/Track-v0", robot=find_robot("hanging_trunk"), task="reach")
    rollout = Rollout.of(env, ["density"])
    actions = np.zeros((3, *env.action_space.shape))
    found = rollout.run(actions).vjp(tip=np.ones((4, 3)))

    def tips(factor):
        other = gymnasium.make(
            "SoftRobot/Track-v0",
            robot=find_robot("hanging_trunk").vary(density=factor),
            task="reach",
        )
        return Rollout.of(other).run(actions).observed.tip.sum()

    h = 1e-4
    assert close((tips(1 + h) - tips(1 - h)) / (2 * h), found.parameters["density"], 1e-3)


ARM = find_robot("planar_finger")
ROD = find_robot("silicone_rod")

REFUSED = [
    (lambda: Rollout(build_scene(SceneConfig(ARM, integrator="implicit"))), "integrator implicit"),
    (
        lambda: Rollout(build_scene(scene_of(replace(ROD, drive=Drive("length", gain=1e4))))),
        "servos with a gain",
    ),
    (lambda: Rollout(build_scene(scene_of(ARM)), ["colour"]), "'colour' is none of"),
    (lambda: Rollout(build_scene(scene_of(ARM)), ["tendons.9.offset"]), "'9' is none of"),
    (lambda: Rollout(build_scene(scene_of(ARM)), ["pieces.0"]), "no number"),
    (lambda: Rollout(build_scene(scene_of(ARM))).run(np.zeros(4)), "a row of inputs"),
    (
        lambda: Rollout(build_scene(scene_of(ARM))).run(np.zeros((2, 4))).vjp(colour=1),
        "choose from position",
    ),
]


@pytest.mark.parametrize(("make", "said"), REFUSED)
def test_refusals(make, said):
    with pytest.raises(ValueError, match=said):
        make()


@pytest.mark.parametrize("copied", [deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_a_copy_has_the_same_derivatives(copied):
    robot = moving(3)
    rollout = Rollout(robot.scene, robot.parameters)
    start = State(robot.position, robot.velocity)
    motion = rollout.run(robot.inputs, start)
    weights = drawn(motion.observed)
    found = motion.vjp(**weights)  # its arrays for this are not copied
    again = copied(rollout).run(robot.inputs, start).vjp(**weights)
    np.testing.assert_array_equal(again.inputs, found.inputs)
    assert again.parameters == found.parameters


def test_environments_load_nothing_of_it():
    code = (
        "import sys, gymnasium, softrobot_env; env = gymnasium.make('SoftRobot/ArmSwing-v0');"
        "env.reset(); env.step(env.action_space.sample());"
        "assert not [m for m in sys.modules if m.startswith('softrobot_env.gradients')]"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_periods_have_derivatives_of_their_own():
    rollout = Rollout.of(gymnasium.make("SoftRobot/ArmSwing-v0"))
    actions, way = np.random.default_rng(0).uniform(-0.3, 0.3, (2, 20, 3))
    motion = rollout.run(actions)
    (by_state, by_input), along = motion.linearised(), motion.jvp(inputs=way)
    state, tips = np.zeros(by_state.shape[1]), motion.tip_by_states()
    for k in range(20):
        state = by_state[k] @ state + by_input[k] @ way[k]
        seen = np.hstack([along.position[k + 1], along.velocity[k + 1]])
        np.testing.assert_allclose(state, seen, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(tips[k + 1] @ state, along.tip[k + 1], rtol=1e-9, atol=1e-12)


def test_actions_along_a_path():
    """A path that some actions make is followed by others, found from zero."""
    rollout = Rollout.of(gymnasium.make("SoftRobot/ArmSwing-v0"))
    times = np.arange(60)[:, None] * [0.05, 0.07, 0.04]
    path = rollout.run(0.3 * np.sin(times) - 0.18).observed.tip
    path[:, 1] = np.nan
    found = follow(rollout, path)
    assert found.error.max() < 1e-3
    assert np.abs(found.inputs).max() <= 1
    np.testing.assert_array_equal(found.motion.observed.tip, rollout.run(found.inputs).observed.tip)
    with pytest.raises(ValueError, match="rollout of an environment"):
        follow(Rollout(build_scene(scene_of(ARM))))
