"""The rig's feedforward controllers: their parts, what they learn of a rig, how well they track."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from softrobot_env.cli import main
from softrobot_env.control.registry import RIG_POLICIES, installed_policies, make_policy
from softrobot_env.control.rig_feedforward import LENGTH_SCALE, RigFeedforward, make_hybrid
from softrobot_env.control.rig_inverse import TOTAL, Motion, OnePiece, SeveralPieces
from softrobot_env.control.rig_learnt import Learnt, calibrate, turned
from softrobot_env.envs.rig import RigEnv
from softrobot_env.envs.servos import Servos
from softrobot_env.evaluation.run import run_episode
from softrobot_env.learned.network import Scaling, initial_network
from softrobot_env.rig_trajectories import RoundedTriangle
from softrobot_env.robots import ARM, RIG
from softrobot_env.training.rig_data import disk_points, nominal_lengths
from softrobot_env.training.rig_statics import RigStatics
from softrobot_env.training.rig_twin_data import Visit, measure
from softrobot_env.training.rig_twin_networks import NEEDED, learn
from softrobot_env.twin import EQUIVALENT, EQUIVALENT_RIG, SERVO_SPEED, nominal_twin

PERIOD = 0.02
FAST = RoundedTriangle(period=1.0, approach=0.0)


def motions(trajectory, times):
    parts = (trajectory.position, trajectory.velocity, trajectory.acceleration)
    return [Motion(*(x[:2] for x in row)) for row in zip(*(f(times) for f in parts), strict=True)]


def observation(motion, previous=None):
    names = ("reference", "reference_velocity", "reference_acceleration")
    seen = dict(zip(names, motion, strict=True))
    return seen | {"previous_action": np.zeros(3) if previous is None else previous}


def follow(policy, wanted):
    """Lengths (k, 3) [m] and states for motions."""
    state, lengths, states = None, [], []
    for motion in wanted:
        action, state = policy.predict(observation(motion), state)
        lengths.append(LENGTH_SCALE * action)
        states.append(state)
    return np.array(lengths), states


# ---------------------------------------------------------------- parts


def test_the_scale_of_actions_is_the_environments():
    assert RigEnv.length_scale == LENGTH_SCALE


def test_a_motion_of_constant_jerk_goes_on_exactly():
    cubic = np.array([[0.3, -0.2, 0.5, 0.7], [0.1, 0.4, -0.6, 0.2]])
    at = [np.polynomial.Polynomial(c) for c in cubic]

    def motion(t):
        return Motion(*(np.array([p.deriv(k)(t) if k else p(t) for p in at]) for k in range(3)))

    jerk = np.array([p.deriv(3)(0.0) for p in at])
    for mine, truth in zip(motion(0.1).after(0.25, jerk), motion(0.35), strict=True):
        np.testing.assert_allclose(mine, truth, atol=1e-14)


def test_the_dynamic_part_vanishes_at_rest():
    still = Motion(np.array([0.06, -0.05]), np.zeros(2), np.zeros(2))
    for model in (OnePiece(RIG), SeveralPieces(RIG)):
        memory = None
        for _ in range(3):
            pull, memory = model.step(memory, still, still, PERIOD)
            assert np.max(np.abs(pull.dynamic)) < 1e-9
    alone = OnePiece(RIG).step(None, still, still, PERIOD)[0].total
    np.testing.assert_allclose(alone, nominal_lengths(RIG, still.position[None], TOTAL)[0])


def test_the_dae_of_one_piece_gives_the_closed_form():
    """Two ways to the same inputs: integration in time, and algebra."""
    times = np.arange(0, 3, PERIOD)
    now, then = motions(FAST, times), motions(FAST, times + PERIOD / 2)
    exact, integrated = OnePiece(RIG), SeveralPieces(RIG, pieces=1)
    one = two = None
    off, size = [], []
    for a, b in zip(now, then, strict=True):
        truth, one = exact.step(one, a, b, PERIOD)
        found, two = integrated.step(two, a, b, PERIOD)
        off.append(found.dynamic - truth.dynamic)
        size.append(truth.dynamic)
    assert np.max(np.abs(size)) > 4e-3
    assert np.max(np.abs(off)) < 0.03 * np.max(np.abs(size))


def test_after_a_jump_the_model_begins_anew_at_rest():
    model = SeveralPieces(RIG)
    here, there = (Motion(np.array(z), np.zeros(2), np.zeros(2)) for z in ((0.0, 0.0), (0.08, 0.0)))
    _, memory = model.step(None, here, here, PERIOD)
    pull, _ = model.step(memory, there, there, PERIOD)
    fresh, _ = model.step(None, there, there, PERIOD)
    np.testing.assert_allclose(pull.total, fresh.total, atol=1e-12)
    assert np.max(np.abs(pull.dynamic)) < 1e-9


def test_a_network_that_knows_the_nominal_statics_makes_the_hybrid_the_model():
    """(5.37) without s_err and (5.36) are (5.38)."""
    known = SimpleNamespace(statics=lambda z: nominal_lengths(RIG, z[None], TOTAL)[0])
    wanted = motions(FAST, np.arange(0, 4, PERIOD))
    hybrid = RigFeedforward(RIG, PERIOD, known, OnePiece(RIG))
    model = RigFeedforward(RIG, PERIOD, None, OnePiece(RIG))
    statics = RigFeedforward(RIG, PERIOD, known)
    lengths, _ = follow(hybrid, wanted)
    np.testing.assert_allclose(lengths, follow(model, wanted)[0], atol=2e-9)
    assert np.max(np.abs(lengths - follow(statics, wanted)[0])) > 4e-3


def test_ahead_is_half_a_period_ahead():
    wanted = motions(FAST, np.arange(0, 4, PERIOD))
    later = motions(FAST, np.arange(0, 4, PERIOD) + PERIOD / 2)
    ahead, _ = follow(RigFeedforward(RIG, PERIOD, None, OnePiece(RIG), ahead=True), wanted)
    truth, _ = follow(RigFeedforward(RIG, PERIOD, None, OnePiece(RIG)), later)
    now, _ = follow(RigFeedforward(RIG, PERIOD, None, OnePiece(RIG)), wanted)
    assert np.max(np.abs(ahead - truth)) < 0.25 * np.max(np.abs(now - truth))


@pytest.mark.parametrize("rate", [0.01, 0.05, -0.09])
def test_servos_are_on_average_where_they_should_be(rate):
    """At a steady rate, in the middle of each period, by the simulated servo."""
    play, start = 0.2e-3, -0.01 * np.sign(rate)
    known = SimpleNamespace(statics=lambda z: np.full(3, start + 10 * rate * z[0]))
    errors = {}
    for compensated in (True, False):
        policy = RigFeedforward(RIG, PERIOD, known, play=play / 2 if compensated else None)
        servos = Servos(SERVO_SPEED, np.zeros(3), np.full(3, play))
        servos.start(np.full(3, start))
        state, fine = None, np.arange(1, 101) * PERIOD / 100
        for t in np.arange(0, 0.2, PERIOD):
            # The reference's first coordinate tells the middle of the period that follows.
            motion = Motion(np.array([0.1 * (t + PERIOD / 2), 0.0]), np.zeros(2), np.zeros(2))
            action, state = policy.predict(observation(motion), state)
            path = servos.move(LENGTH_SCALE * action.astype(float), fine)[1:]
            path = np.concatenate([path, np.tile(path[-1], (100 - len(path), 1))])
            errors[compensated] = abs(path.mean() - (start + rate * (t + PERIOD / 2)))
    assert errors[True] < 0.02e-3 < 0.1e-3 < errors[False]


# ---------------------------------------------------------------- observations and options


@pytest.mark.parametrize("name", ["inverse_dynamics", "hybrid_flexible"])
def test_what_cannot_be_done_is_said(name):
    policy = make_policy(name, RIG, PERIOD)
    wanted = motions(FAST, np.arange(0, 0.1, PERIOD))
    _, state = policy.predict(observation(wanted[0]), None)
    previous = np.array([0.1, -0.2, 0.3])
    far = Motion(np.array([0.19, 0.0]), np.zeros(2), np.zeros(2))
    bad = Motion(np.array([np.nan, 0.0]), np.zeros(2), np.zeros(2))
    for motion, status in ((far, "reference out of reach"), (bad, "observation not finite")):
        action, after = policy.predict(observation(motion, previous), state)
        np.testing.assert_allclose(action, previous, atol=1e-7)
        assert after.status == status
        action, after = policy.predict(observation(wanted[0]), after)
        assert after.status is None and np.all(np.isfinite(action))


def test_beyond_the_network_s_points_is_said():
    policy = make_policy("rig_nn", RIG, PERIOD)
    for x, status in ((0.121, None), (0.126, "outside the trained workspace")):
        still = Motion(np.array([x, 0.0]), np.zeros(2), np.zeros(2))
        assert policy.predict(observation(still), None)[1].status == status


def test_parts_that_do_not_exist_are_refused():
    with pytest.raises(ValueError, match="choose from one piece, several pieces, calibrated"):
        make_hybrid(RIG, PERIOD, model="two pieces")
    with pytest.raises(ValueError, match="needs learnt statics, a model or both"):
        RigFeedforward(RIG, PERIOD)


def test_the_rig_s_policies_are_not_the_arm_s():
    assert not set(RIG_POLICIES) & set(installed_policies())


# ---------------------------------------------------------------- what is learnt of a rig


def test_calibration_finds_the_turn_and_the_stiffness():
    """Of one piece, which stands as several pieces of 1.2 times its stiffness do."""
    points = disk_points(60, 0.11)
    rig = RigStatics(turned(RIG, 0.9, 0.12), friction=0.0, noise=0.0)
    lengths = nominal_lengths(RIG, points, TOTAL)
    stiffness, turn = calibrate(RIG, lengths, rig(lengths))
    assert turn == pytest.approx(0.12, abs=1e-3)
    assert stiffness == pytest.approx(0.9 * EQUIVALENT, rel=0.04)


def test_too_little_data_are_refused():
    with pytest.raises(ValueError, match="three lengths"):
        calibrate(RIG, np.zeros((2, 3)), np.zeros((2, 2)))
    with pytest.raises(ValueError, match=f"need {NEEDED} points"):
        learn(SimpleNamespace(lengths=np.zeros((20, 3))))


def test_what_is_learnt_can_be_kept(tmp_path):
    box = Scaling(-np.ones(2), np.ones(2)), Scaling(-np.ones(3), np.ones(3))
    learnt = Learnt(initial_network((4,), *box, np.random.default_rng(0)), 1.07, 0.12)
    learnt.save(tmp_path / "rig.npz", RIG, {"twin": 3})
    loaded = Learnt.load(RIG, tmp_path / "rig.npz")
    point = np.array([0.3, -0.2])
    np.testing.assert_array_equal(loaded.statics(point), learnt.statics(point))
    assert (loaded.stiffness, loaded.turn) == (1.07, 0.12)
    with pytest.raises(ValueError, match="not for this 'arm'"):
        Learnt.load(ARM, tmp_path / "rig.npz")


def test_measured_outputs_are_the_equilibria():
    """Those that the environment's own statics find, but for the end of the swaying."""
    twin = nominal_twin(EQUIVALENT_RIG)
    lengths = nominal_lengths(RIG, np.array([[0.05, 0.02], [-0.03, 0.07], [0.0, -0.1]]), TOTAL)
    found = measure(twin, lengths)
    env = RigEnv("triangle", twin=twin)
    for point, length in zip(found, lengths, strict=True):
        at_rest, _ = env.reset(options={"start_length": length})
        assert np.linalg.norm(point - at_rest["tip_position"]) < 0.4e-3


def test_dither_takes_out_the_play_of_the_servos():
    ideal = nominal_twin(EQUIVALENT_RIG)
    loose = replace(ideal, backlash=(0.3e-3,) * 3)
    points = np.array([[0.0, 0.0], [0.07, 0.0], [0.11, 0.03], [0.07, 0.0]])
    lengths = nominal_lengths(RIG, points, TOTAL)
    truth = measure(ideal, lengths)[1:]
    off = {}
    for dither in (0.0, 0.6e-3):
        found = measure(loose, lengths, visit=Visit(dither=dither))[1:]
        off[dither] = np.linalg.norm(found - truth, axis=1).max()
    assert off[0.6e-3] < 0.2e-3 < 0.6e-3 < off[0.0]


def test_processes_measure_what_one_does():
    lengths = nominal_lengths(RIG, disk_points(4, 0.05), TOTAL)
    quick = Visit(move=0.2, rest=0.1, pictures=2)
    one, two = (measure(3, lengths, 1, runs=2, processes=n, visit=quick) for n in (1, 2))
    np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize(
    ("lengths", "options", "message"),
    [
        (np.zeros((2, 2)), {}, "shape"),
        (np.full((2, 3), 0.031), {}, "0.03 m"),
        (np.full((2, 3), np.nan), {}, "0.03 m"),
        (np.zeros((2, 3)), {"runs": 0}, "one run"),
    ],
)
def test_measurements_that_cannot_be_made_are_refused(lengths, options, message):
    with pytest.raises(ValueError, match=message):
        measure(None, lengths, **options)


def test_twins_are_trained_for_one_artefact_only(tmp_path, capsys):
    assert main(["train", "lqi", "--twin", "1", "--out", str(tmp_path)]) != 0
    assert "--twin: only with rig_nn" in capsys.readouterr().err


# ---------------------------------------------------------------- closed loop


def test_fast_triangle_with_a_calibrated_model():
    """Mean error after the approach; the thesis' best has 8.6 mm, its network alone 35.9 mm."""
    env = RigEnv("triangle", period=1.0, twin=0, observe="all")
    error = {}
    for name in ("rig_nn", "hybrid_calibrated"):
        rollout = run_episode(env, make_policy(name, RIG, env.control_period), seed=0)
        assert rollout.failure is None and set(rollout.policy_status) == {""}
        error[name] = rollout.error[rollout.time > 10].mean()
    assert error["hybrid_calibrated"] < 4e-3
    assert error["rig_nn"] > 20e-3
