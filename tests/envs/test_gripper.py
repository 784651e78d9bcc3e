"""Environments of the gripper: contract, one and many alike, physics of what they draw."""

import json
from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.control.gripper import (
    ScriptedGrip,
    SizedGrip,
    SizeEstimator,
    calibrated,
    size_by_sensor,
)
from softrobot_env.envs.gripper import GripperEnv, VectorGripperEnv
from softrobot_env.envs.simulation.grippers import KNOWN, shares
from softrobot_env.robots import GRIPPERS
from softrobot_env.robots.file import write_gripper
from softrobot_env.scene.assembly import FINENESS, build_assembly, gripper_scene
from softrobot_env.scene.simulation import Simulation
from softrobot_env.tasks.gripper import SAMPLED

pytestmark = pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")

GRIPPER = GRIPPERS["gripper"]
LIKE = {"modulus": 1.0, "arm": 1.0, "friction": 0.8}


def closing(env, tension, steps, rise=20, observation=None):
    """Step a single environment; the last result."""
    for k in range(steps):
        level = 2 * tension * min(1.0, (k + 1) / rise) / GRIPPER.tension_limits - 1
        out = env.step(level.astype(np.float32))
        if out[2] or out[3]:
            break
    return out


# --- contract ---------------------------------------------------------------------------------


def test_info_is_flat_and_names_the_reward():
    env = GripperEnv("hold")
    observation, info = env.reset(seed=3)
    assert env.observation_space.contains(observation)
    *_, reward, failed, over, info = closing(env, 20.0, 5)
    assert not failed and not over
    assert all(isinstance(v, np.generic | np.ndarray) for v in info.values())
    assert reward == pytest.approx(sum(v for n, v in info.items() if n.startswith("reward_")))
    assert set(SAMPLED) <= set(info) and info["success"] == np.False_
    assert info["time"] == pytest.approx(5 * env.control_period)


def test_observables_are_those_of_each_finger():
    env = GripperEnv("hold", observe="all")
    observation, _ = env.reset(seed=0)
    every = [name for name in KNOWN if name != "sensors"]
    assert set(observation) == set(every)
    sizes = {name: value.shape[0] for name, value in observation.items()}
    assert [sizes[name] for name in every] == [9, 9, 3, 3, 3]
    observation, *_ = closing(env, 20.0, 40)
    assert (observation["curvature"] > 0).all() and (observation["contact"] > 0.1).all()
    np.testing.assert_allclose(observation["tendon_tension"], 20.0)
    np.testing.assert_allclose(observation["previous_action"], 0.0, atol=1e-6)
    posture = env.simulation.qpos[0]
    for k, part in enumerate(env.simulation.scene.parts.values()):
        own = part.curvature(posture)[:, 1].reshape(3, -1).mean(axis=1)
        np.testing.assert_allclose(observation["curvature"][3 * k : 3 * k + 3], own, atol=1e-9)


def test_a_gripper_from_a_file_is_gripped_with(tmp_path):
    two = replace(GRIPPER, name="two", fingers=GRIPPER.fingers[:2])
    write_gripper(two, tmp_path / "two.toml")
    env = GripperEnv("enclose", gripper=str(tmp_path / "two.toml"))
    observation, _ = env.reset(seed=0)
    assert env.action_space.shape == (2,) and observation["curvature"].shape == (6,)
    assert env.step(np.zeros(2, dtype=np.float32))[0]["curvature"].all()


# --- physics ----------------------------------------------------------------------------------


def test_what_is_drawn_is_what_a_scene_of_it_would_be():
    """Sizes, masses and friction that are set afterwards act as those a scene is built with."""
    env = GripperEnv("hold")
    drawn = {"diameter": 0.052, "mass": 0.14, "friction": 0.7, "modulus": 0.9, "arm": 1.04}
    _, info = env.reset(seed=0, options=drawn | {"pull": 0.0, "shake": 0.0})
    built = env.simulation.scene
    radius = info["diameter"] / 2
    bar = replace(
        built.config.objects[-1],
        radius=radius,
        mass=0.14,
        friction=0.7,
        position=(0.0, 0.0, info["bar_position"][2]),
    )
    fingers = [
        replace(f, robot=f.robot.vary(youngs_modulus=0.9, tendon_radius=1.04))
        for f in GRIPPER.fingers
    ]
    how = {"contacts": built.config.contacts, "pieces": 6, "timestep": built.timestep.timestep}
    scene = build_assembly(gripper_scene(replace(GRIPPER, fingers=tuple(fingers)), (bar,), **how))
    simulation = Simulation(scene)
    simulation.reset(scene.model.qpos0, np.zeros(3))
    for _ in range(40):
        simulation.ctrl[:] = 15.0
        assert simulation.advance()
        observation, *_ = env.step(np.full(3, 2 * 15.0 / 40 - 1, dtype=np.float32))
    found = [part.curvature(simulation.posture)[:, 1] for part in scene.parts.values()]
    means = np.concatenate([c.reshape(3, -1).mean(axis=1) for c in found])
    np.testing.assert_allclose(observation["curvature"], means, rtol=0.02, atol=0.05)
    np.testing.assert_allclose(env.simulation.place[0], simulation.data.body("bar").xpos, atol=1e-4)


def test_shaking_the_palm_is_felt_as_gravity_the_other_way():
    """Fingers that hold nothing fast: a constant acceleration is the weight of its opposite."""
    env = GripperEnv("hold")
    env.reset(seed=0, options={"pull": 0.0, "shake": 0.0})
    batch = env.simulation
    batch.push(np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, 2.0]]))
    np.testing.assert_allclose(batch.gravity[0], [0, 0, -11.81])
    batch.qpos[0, -5] += 0.5  # where it touches nothing
    batch.advance()
    before = float(batch.qvel[0, -4])
    batch.advance()
    fall = -11.81 + 1.0 / float(env._all._sampled["mass"][0])
    assert batch.qvel[0, -4] - before == pytest.approx(fall * env.control_period, rel=1e-3)


def test_a_scripted_closing_encloses_and_open_fingers_do_not():
    env = GripperEnv("enclose")
    for tension, encloses in ((18.0, True), (1.0, False), (39.0, False)):
        env.reset(seed=0, options=LIKE | {"diameter": 0.060 if encloses else 0.075})
        *_, over, info = closing(env, tension, 200)
        assert over and bool(info["success"]) == encloses


def test_a_bar_is_held_or_lost():
    env = GripperEnv("hold")
    options = LIKE | {"diameter": 0.06, "mass": 0.05, "pull": np.array([0.0, 0.0, 2.0])}
    env.reset(seed=0, options=options)
    _, _, failed, over, info = closing(env, 25.0, 200)
    assert over and not failed and info["success"]
    env.reset(seed=0, options=options)
    _, reward, failed, over, info = closing(env, 0.0, 200)
    assert failed and not over and "the bar was lost by t =" in info["failure"]
    assert reward == -10.0 == info["reward_failure"]


@pytest.mark.slow
def test_quick_grippers_err_less_than_the_thesis_sensors():
    """2.5 degrees in the mean, against the rule's; where friction stops late they slide too far."""
    fine = FINENESS["quick"]
    late = replace(fine, contacts=replace(fine.contacts, stopping=1.0))
    runs = []
    for fineness in ("rule", "quick", late):
        env = VectorGripperEnv(3, "enclose", fineness=fineness)
        env.reset(seed=40, options={"friction": 0.8})
        bends = []
        for k in range(50):
            level = 2 * 30.0 * min(1.0, (k + 1) / 25) / GRIPPER.tension_limits - 1
            env.step(np.tile(level, (3, 1)).astype(np.float32))
            bends.append(np.degrees(env.simulation.curvature) * 0.03)
        runs.append(np.array(bends))
    quick, later = (np.abs(run - runs[0]) for run in runs[1:])
    assert quick.mean() < 2.5 and quick[-1].mean() < 0.8 * later[-1].mean()


# --- sensors ----------------------------------------------------------------------------------

SEEN = {"observe": ("curvature", "sensors", "tendon_tension")}


def test_tags_see_the_turns_of_their_finger_and_light_falls():
    """Seven tags of ideal sensors add up to the finger's bend, by another path than theirs."""
    env = GripperEnv("enclose", **SEEN)
    start, _ = env.reset(seed=1, options={"sensor_errors": 0.0, "diameter": 0.06})
    observation, *_ = closing(env, 20.0, 60)
    assert env.observation_space.contains(observation)
    before, after = (o["sensors"].reshape(3, 9) for o in (start, observation))
    turns = 0.03 * observation["curvature"].reshape(3, 3)
    noise = 6 * 5e-3 * np.sqrt(2)  # of two intervals of tags along each sensor
    np.testing.assert_allclose(after[:, 3:].reshape(3, 3, 2).sum(axis=2), turns, atol=noise)
    np.testing.assert_allclose(before[:, :3], 1.0, atol=6 * 1.4 / 1930)
    assert (after[:, :3] < 0.95).all()


def test_links_feel_what_their_finger_does_and_its_sensors_too():
    """Along a finger the links' forces add up to that of the finger, and none is counted twice."""
    env = GripperEnv("enclose", **SEEN)
    env.reset(seed=1, options={"diameter": 0.06})
    closing(env, 25.0, 60)
    batch = env.simulation
    for k in range(3):
        pressed = batch.pressed(k)[0]
        np.testing.assert_allclose(pressed.sum(axis=0), batch.felt[0, k], atol=1e-12)
        low, high = batch.links(k).T
        sensors = env.gripper.fingers[k].robot.sensors
        parts = shares(batch.links(k), sensors)
        np.testing.assert_allclose(parts[:, :3].sum(axis=1), 1.0)  # one behind the other
        np.testing.assert_allclose(parts[:, 3], 1.0)  # the tags, along all of it
        across = (low < 0.03) & (high > 0.03)
        assert ((parts[across, 0] > 0) & (parts[across, 1] > 0)).all()


def test_a_contact_leaks_light_into_the_sensor_it_presses_on():
    """Two grippers that differ in nothing but what a contact does to their light."""

    def light(stray):
        robot = GRIPPER.fingers[0].robot
        sensors = tuple(replace(s, stray=stray, noise=0.0) for s in robot.sensors)
        fingers = [replace(f, robot=replace(robot, sensors=sensors)) for f in GRIPPER.fingers]
        own = replace(GRIPPER, fingers=tuple(fingers))
        env = GripperEnv("enclose", gripper=own, **SEEN)
        env.reset(seed=1, options={"diameter": 0.06, "sensor_errors": 0.0})
        observation, *_ = closing(env, 25.0, 60)
        force = env.simulation.pressed(0)[0]
        parts = shares(env.simulation.links(0), sensors)
        return observation["sensors"][:3], np.linalg.norm(force, axis=1) @ parts[:, :3]

    (dark, force), (lit, _) = light(0.0), light(0.02)
    np.testing.assert_allclose(lit - dark, 0.02 * force, atol=1.01 / 1930)
    assert force.max() > 0.5


def test_specimens_are_those_of_their_numbers():
    many = VectorGripperEnv(3, "enclose", **SEEN)
    own = {"specimen": [5.0, 5.0, 6.0], "diameter": 0.06, "modulus": 1.0, "arm": 1.0}
    first, info = many.reset(seed=2, options=own | {"friction": 0.8})
    light = first["sensors"].reshape(3, 3, 9)[:, :, :3]
    assert np.abs(light[0] - light[1]).max() < 0.05 and (info["sensor_errors"] == 1).all()
    assert np.abs(light[0] - light[2]).max() > 0.05
    assert np.abs(light[0, 0] - light[0, 1]).max() > 0.01  # each finger has its own


# --- policies ---------------------------------------------------------------------------------


def test_sizes_of_other_bars_and_fingers_are_told_from_one_grip():
    """By sensors, fitted with 6 pieces; told of fingers of 12, which are nearer to the truth."""

    def bends(count, seed, **how):
        env, state = VectorGripperEnv(count, "enclose", **SEEN, **how), None
        _, drawn = env.reset(seed=seed)
        specimens = {name: drawn[name] for name in ("modulus", "arm", "specimen")}
        calibration = calibrated(env, specimens, seed + 1000)
        start, info = env.reset(seed=seed)
        observation, policy = start, ScriptedGrip(GRIPPER, env.control_period, 16.0)
        for _ in range(35):
            action, state = policy.predict(observation, state)
            observation, *_ = env.step(action)
        measured = calibration.curvature(observation["sensors"], start["sensors"])
        off = np.degrees(np.abs(measured - observation["curvature"])) * 0.03
        assert off.mean() < 2.5  # thesis, of enclosing grips
        return measured, info["diameter"], calibration, specimens

    measured, diameters, *_ = bends(60, 100)
    estimator = SizeEstimator.fitted(GRIPPER, 16.0, measured, diameters)
    seen, truth, calibration, specimens = bends(8, 900, pieces=12, timestep=1e-3)
    assert np.abs(estimator(seen) - truth).max() < 2e-3
    assert np.abs(size_by_sensor(GRIPPER, seen) - truth).max() > 2e-3
    env = VectorGripperEnv(8, "enclose", **SEEN)
    observation, info = env.reset(seed=7, options=specimens)
    policy = SizedGrip(GRIPPER, env.control_period, size=estimator, sensors=calibration)
    state = None
    for _ in range(40):
        action, state = policy.predict(observation, state)
        observation, *_ = env.step(action)
    assert np.abs(state["diameter"] - info["diameter"]).max() < 2e-3
    with pytest.raises(ValueError, match="need 20 examples"):
        SizeEstimator.fitted(GRIPPER, 16.0, seen, truth)
    assert json.dumps(estimator.weights.tolist())
