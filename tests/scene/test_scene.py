"""What a scene offers to Python, in the words of the beam models: places, motions, equilibria."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.chains import KINDS, LENGTH, ROBOT, chain
from support.derivatives import differences
from support.postures import moved, posed, station_turns

from softrobot_env.core.motion import IntegrationError, State
from softrobot_env.robots import ARM, Tendon
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import joint_angles
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.integration.integrator import RESOLVED
from softrobot_env.scene.quadrature import RULES
from softrobot_env.scene.simulation import WORRYING, Simulation
from softrobot_env.scene.timestep import linearize
from studies.truths.varying_beam import bending_frequencies


def bent(built, seed=0):
    """A posture."""
    turns = np.random.default_rng(seed).normal(0, 0.2, built.model.nv)
    return moved(built.model, built.model.qpos0, turns)


# --- places -----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_positions_are_those_of_sites_at_the_stations(kind):
    loads = tuple(Load(f"l{k}", s) for k, s in enumerate((0.0, 0.21, 0.5, LENGTH)))
    built = chain(kind, rule=None, loads=loads)
    q = bent(built)
    data = posed(built.model, q)
    truth = [data.site(f"{load.name}_point").xpos for load in loads]
    stations = np.array([load.station for load in loads])
    np.testing.assert_allclose(built.positions(q, stations), truth, atol=1e-14)
    np.testing.assert_allclose(built.tip(q), truth[-1], atol=1e-14)
    series = np.stack([q, built.start().q])
    np.testing.assert_allclose(built.positions(series, stations)[0], truth, atol=1e-14)
    straight = np.outer(stations, [0, 0, 1])
    np.testing.assert_allclose(built.positions(series, stations)[1], straight, atol=1e-14)
    assert built.tip(series).shape == (2, 3)


@pytest.mark.parametrize("kind", KINDS)
def test_velocities_are_the_rate_of_the_positions(kind):
    built, stations = chain(kind, rule=None), np.array([0.0, 0.2, LENGTH])
    q, v = bent(built), np.random.default_rng(1).normal(size=built.model.nv)

    def places(time):
        return built.positions(moved(built.model, q, time * v), stations)

    truth = differences(places, np.zeros(1), 1e-6)[..., 0]
    np.testing.assert_allclose(built.velocities(q, v, stations), truth, atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_curvature_is_that_of_the_stations_rotations(kind):
    built = chain(kind, rule=None)
    q, pieces = bent(built), built.layout.pieces
    turns = station_turns(built.model, q).reshape(pieces, -1, 3).sum(axis=1)
    np.testing.assert_allclose(built.curvature(q), turns / built.layout.sizes[:, None], atol=1e-12)


def test_tendon_length_is_what_is_inside():
    tendon = Tendon("t", (0.02, 0.0), LENGTH, 0, 80.0)
    built = chain("universal", replace(ROBOT, tendons=(tendon,)))
    assert built.tendon_length(built.start().q) == pytest.approx([LENGTH])
    q = bent(built)
    truth = LENGTH - 0.02 * joint_angles(built.model, q)[:, 0].sum()
    assert built.tendon_length(q) == pytest.approx([truth])


# --- equilibria and motions -------------------------------------------------------------------


def test_inputs_are_tendons_then_loads():
    built = build_scene(SceneConfig(ARM, loads=(Load("push", 0.3, (1.0, 0, 0)),)))
    assert built.input_names == (*(t.name for t in ARM.tendons), "push")
    assert built.n_inputs == len(ARM.tendons) + 1
    np.testing.assert_allclose(built.equilibrium(), 0, atol=1e-3 if ARM.gravity[0] else 1e-12)


def test_a_small_swing_has_the_beams_frequency():
    """Half a period after it was let go at rest the first mode is on the other side."""
    robot = replace(ROBOT, damping_time=0.0)
    half = 0.5 / bending_frequencies(robot)[0]
    built = chain(robot=robot, control_period=half / 50, pieces=12)
    first = SceneConfig(robot, pieces=12, loads=(Load("pull", LENGTH, (1e-3, 0, 0)),))
    # What a force on the tip bends is the first mode to 3 %, and starts slow.
    start = build_scene(first).equilibrium(np.ones(1))
    motion = built.simulate(2 * half, start=State(start, np.zeros(built.model.nv)), samples=half)
    tips = built.tip(motion.q)[:, 0]
    np.testing.assert_allclose(tips[1:] / tips[0], [-1, 1], atol=0.06)
    np.testing.assert_allclose(motion.time, [0, half, 2 * half])
    assert motion.q.shape == (3, built.model.nq)
    np.testing.assert_array_equal(motion.end.v, motion.v[-1])


@pytest.mark.parametrize("kind", ["planar", "three_hinges"])
def test_a_damped_motion_ends_in_the_equilibrium_of_its_gravity(kind):
    robot = replace(KINDS[kind][0], damping_time=0.3)
    built, gravity = chain(kind, robot, rule=None, pieces=2), np.array([4.0, 0.0, -2.0])
    truth = built.equilibrium(gravity=gravity)
    end = built.simulate(12.0, gravity=gravity).end
    np.testing.assert_allclose(end.q, truth, atol=1e-5)
    np.testing.assert_array_equal(built.model.opt.gravity, 0.0)


def test_inputs_may_be_held_or_steady():
    """Rows at the middle of short periods come to the motion that a function gives.

    But for the half timestep by which integrators of first order let held forces act early.
    """
    load = Load("push", LENGTH, (1.0, 0.0, 0.0))
    built = chain(pieces=3, loads=(load,), control_period=1e-3)

    def ramp(time):
        return np.array([np.sin(3 * time)])

    truth = built.tip(built.simulate(0.2, ramp).end.q)
    rows = np.stack([ramp((k + 0.5) * 1e-3) for k in range(200)])
    held = built.tip(built.simulate(0.2, rows).end.q)
    still = built.tip(built.simulate(0.2, np.zeros(1)).end.q)
    assert np.linalg.norm(truth - still) > 5e-3
    speed = np.linalg.norm(truth - built.tip(built.simulate(0.199, ramp).end.q)) / 1e-3
    assert np.linalg.norm(held - truth) < 0.6e-3 * speed
    constant = built.simulate(0.2, np.ones(1))
    np.testing.assert_array_equal(built.simulate(0.2, np.ones((200, 1))).q, constant.q)


def test_a_motion_tells_its_error():
    built = chain(pieces=6, loads=(Load("push", LENGTH, (1.0, 0.0, 0.0)),), control_period=0.01)
    fine = replace(built.config, accuracy=1e-7)
    pushes = np.random.default_rng(1).random((60, 1))
    motion = built.simulate(0.6, pushes, samples=0.1)
    truth = build_scene(fine).simulate(0.6, pushes, samples=0.1)
    errors = np.linalg.norm(built.tip(motion.q) - built.tip(truth.q), axis=1)
    assert motion.integration_error[0] == pytest.approx(RESOLVED * built.timestep.accuracy)
    assert np.all(np.diff(motion.integration_error) >= 0)
    assert np.max(errors) < built.timestep.accuracy
    # Speeds count in it: it may be larger than any displacement, but not worth a warning.
    assert np.max(errors) < motion.integration_error[-1] < WORRYING * built.timestep.accuracy
    assert build_scene(replace(fine, integrator="RK4")).simulate(0.1).integration_error is None


def test_divergence_is_an_error():
    with pytest.warns(UserWarning, match="stability limit"):
        built = chain(integrator="Euler", timestep=0.05, control_period=0.05)
    v = np.full(built.model.nv, 50.0)
    with pytest.raises(IntegrationError, match="diverged") as error:
        built.simulate(5.0, start=State(built.start().q, v))
    assert 0 < error.value.time < 5


# --- models in motion -----------------------------------------------------------------------


def frequency_errors(rule, n):
    """Relative errors of the first three frequencies of n hinges against the exact beam."""
    bare, pieces = replace(ARM, tendons=()), n // len(RULES[rule])
    model = build_scene(SceneConfig(bare, pieces=pieces, rule=rule)).model
    found = linearize(model).frequencies()[:3] / (2 * np.pi)
    return np.abs(found / bending_frequencies(ARM, 3) - 1)


@pytest.mark.parametrize("rule", RULES)
def test_frequencies_converge_with_second_order_and_coupled_with_more(rule):
    first, coarse, fine = (frequency_errors(rule, n) for n in (12, 24, 48))
    if rule == "coupled2":
        assert np.all(np.log2(first / coarse) > 3.3)
        assert first[0] < frequency_errors("balanced2", 12)[0] / 4
    else:
        np.testing.assert_allclose(np.log2(coarse / fine), 2, atol=0.2)


@pytest.mark.parametrize("integrator", ["implicitfast", "discrete", "RK4"])
def test_advance_is_a_sequence_of_plain_steps_with_current_read_outs(integrator):
    scene = build_scene(SceneConfig(ARM, integrator=integrator))
    simulation, data = Simulation(scene), mujoco.MjData(scene.model)
    tendon_map, start = TendonMap(ARM), np.linspace(0.0, 0.1, 12)
    simulation.reset(start, np.zeros(6))
    data.qpos[:] = start
    for k in range(20):
        tension = tendon_map.tension(20 * np.sin([0.3 * k, 0.7 * k, 1.1 * k]))
        simulation.data.ctrl[:] = data.ctrl[:] = tension
        simulation.advance()
        mujoco.mj_step(scene.model, data, scene.timestep.substeps)
        np.testing.assert_array_equal(simulation.data.qpos, data.qpos)
        np.testing.assert_array_equal(simulation.data.qvel, data.qvel)
        tip = posed(scene.model, data.qpos).site("tip").xpos
        np.testing.assert_array_equal(simulation.data.site("tip").xpos, tip)
    assert simulation.data.time == data.time == pytest.approx(0.2)
    assert simulation.failure() is None
