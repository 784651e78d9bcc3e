"""Feedback of a late tip, on a plant of one mode whose motion is known exactly."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from softrobot_env.control.feedforward.dynamics import InverseDynamics
from softrobot_env.control.feedforward.feedback import Feedback, ReferenceFeedback
from softrobot_env.control.feedforward.motion import DifferenceFilter, Motion
from softrobot_env.control.feedforward.nearby import Nearby, Neighbourhood, _held
from softrobot_env.control.feedforward.statics import ChainStatics, Rest
from softrobot_env.robots import ARM, EQUIVALENT_RIG, find_robot
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.linearised import linearised
from softrobot_env.scene.registry import RIG_PIECES, model_scene

RIG, TRUNK = replace(EQUIVALENT_RIG, pieces=RIG_PIECES), find_robot("hanging_trunk")

FREQUENCY, DAMPING_TIME = 7.0, 0.07  # rad/s, s
REST = Rest(np.zeros(1))
AWAY = 3.0  # m per share that the robot is softer
SCALE = 20.0  # m, by a full scale of the input
REACH = 100.0  # m


def statics():
    """Of a robot whose input is its tip's place."""
    return SimpleNamespace(
        first_mode=lambda: (FREQUENCY, DAMPING_TIME),
        shifted=lambda rest, change, linear=None: (change, False),
        inputs=SimpleNamespace(n_inputs=1, input_scale=np.array([SCALE]), input_centre=np.zeros(1)),
    )


def neighbourhood(period):
    """Of the same robot, whose poses at rest account for no difference."""
    forces = np.array([[-AWAY, 0.0, 0.0, SCALE]])
    one = np.ones((1, 1))
    held = _held(one / FREQUENCY**2, DAMPING_TIME * one, one, period)

    def about(rest, motion, differs, before):
        none, ways = np.zeros(1), forces.T
        moving = differs.stiffer * forces[0, :1]
        return Nearby(
            rest, None, forces, forces[:, 3:], ways, moving, none, None, *held, one, 0 * one
        )

    return SimpleNamespace(reach=REACH, modes=one, n_built=0, about=about)


def errors(period, delay, offset=1.0, duration=30.0, given=None, learning=False, drive=(0, 0)):
    """Tips (n,) that should be at 0 but are pulled `offset` away, and the last state.

    Of a drive that is so many periods late, and is believed to be so many.
    """
    square = FREQUENCY**2
    rates = np.array([[0, 1, 0], [-square, -DAMPING_TIME * square, square], [0, 0, 0]])
    move = expm(period * rates)
    near = neighbourhood(period) if learning else None
    given = delay * period if given is None else given
    lag, told = drive
    late = {"tip_delay": given, "drive_delay": told * period}
    feedback = Feedback(statics(), period, learning=near, **late)
    still = Motion(*np.zeros((3, 1)))
    felt, state, seen = feedback.start(np.zeros(1)), np.zeros(3), [0.0] * (delay + 1)
    asked = [0.0] * lag
    for _ in range(round(duration / period)):
        tip = np.array([seen[-1 - delay]])
        more, felt, _ = feedback.added(REST, still, np.zeros(1), tip, felt)
        asked.append(more[0])
        state[2] = asked.pop(0) + offset
        state = move @ state
        seen.append(state[0])
    return np.array(seen), felt


@pytest.mark.parametrize("learning", [False, True])
@pytest.mark.parametrize(("period", "delay"), [(0.02, 0), (0.02, 1), (0.01, 4), (0.05, 2)])
def test_the_tip_comes_to_rest_however_late_it_is_seen(period, delay, learning):
    seen, _ = errors(period, delay, learning=learning)
    assert np.abs(seen[-20:]).max() < 1e-2


def test_gains_that_are_not_told_of_the_delay_are_unstable():
    seen, _ = errors(0.02, 4, given=0.0)
    assert np.abs(seen[-20:]).max() > 1.0


@pytest.mark.parametrize("learning", [False, True])
@pytest.mark.parametrize("delay", [0, 2])
def test_drives_may_be_late_if_that_is_told(learning, delay):
    knows, does_not = (
        errors(0.02, delay, learning=learning, drive=(4, told))[0] for told in (4, 0)
    )
    assert np.abs(knows[-20:]).max() < 1e-2
    assert delay or np.abs(does_not[-20:]).max() > 1.0


@pytest.mark.parametrize(
    ("sizes", "changes", "message"),
    [
        ({}, {}, "does not say the size of its reference"),
        ({"reference": 2}, {"proportional": -0.1}, "proportional"),
        ({"reference": 2}, {"integral": -2.0}, "integral"),
        ({"reference": 2}, {"tip_delay": -0.04}, "tip_delay"),
        ({"reference": 2}, {"control_period": 0.0}, "control_period"),
    ],
)
def test_what_moved_references_need_is_named(sizes, changes, message):
    given = {"control_period": 0.02, "proportional": 0.3, "integral": 2.0} | changes
    with pytest.raises(ValueError, match=message):
        ReferenceFeedback(SimpleNamespace(sizes=sizes), **given)


def test_what_is_learned_holds_the_tip_where_it_was_not_yet():
    """An offset and a softer spring pull alike at one place, and are told apart by two."""
    kept = DifferenceFilter(1, 0, reach=1.0, frequency=5.0, period=0.02)
    true, found = np.array([-0.2, 0.0, 0.0, 0.03]), kept.begin()
    for k in range(4000):
        place = np.sin(0.05 * k)
        ways = np.array([[-3.0 * place], [0.0], [0.0], [2.0]])
        found = kept.updated(found, -ways.T @ true, ways, 0.0)
    np.testing.assert_allclose(found.mean, true, atol=2e-3)


def test_unknowns_that_are_not_seen_stay_as_unknown_as_they_were():
    kept = DifferenceFilter(2, 3, reach=1.0, frequency=5.0, period=0.02)
    before = kept.begin()
    after = kept.updated(before, np.zeros(2), np.zeros((8, 2)), 0.0)
    assert (np.diag(after.covariance) > np.diag(before.covariance)).all()
    np.testing.assert_array_equal(after.mean, before.mean)


def test_less_is_learned_from_a_tip_that_is_far_off():
    kept = DifferenceFilter(1, 0, reach=1.0, frequency=5.0, period=0.02)
    ways = np.array([[1.0], [0.0], [0.0], [1.0]])
    near, far = (kept.updated(kept.begin(), np.full(1, 0.3), ways, x).mean for x in (0.01, 0.3))
    assert (np.abs(far[[0, 3]]) < 0.2 * np.abs(near[[0, 3]])).all()


def _heavier(robot, mass):
    """With a mass [kg] more at the tip."""
    head = robot.head
    whole = head.mass + mass
    centre = (head.mass * head.centre + mass * head.output) / whole
    return replace(robot, head=replace(head, mass=whole, centre=centre))


@pytest.mark.parametrize(
    ("robot", "place"), [(RIG, (0.05, 0.03)), (ARM, (0.2, 0.4)), (TRUNK, (0.05, -0.04))]
)
def test_ways_are_those_of_equilibria_of_robots_that_differ(robot, place):
    """Against the tips of other chains under the same inputs, by differences to both sides."""
    statics, step = ChainStatics(robot), 1e-4
    rest = statics.hold(np.array(place), statics.begin(statics.inputs.input_centre), True)
    still = Motion(np.array(place), *np.zeros((2, 2)))
    near = Neighbourhood(statics, 0.02)
    unknown = DifferenceFilter(statics.inputs.n_inputs, near.n_built, 1.0, 1.0, 0.02).begin()
    ways = near.about(rest, still, unknown, None).ways

    def way(changed, least=None):
        """By a change to both sides; to one side, from the least one."""
        above, below = changed(step), changed(-step if least is None else least)
        moved = _tip(statics, *above) - _tip(statics, *below)
        return moved / (2 * step if least is None else step)

    found = {0: way(lambda x: (robot.vary(youngs_modulus=1 + x), rest.inputs)), 1: np.zeros(2)}
    if robot.head is not None:
        mass = statics.scene.model.body_mass.sum()
        found[2] = way(lambda x: (_heavier(robot, x * mass), rest.inputs))
    scale = statics.inputs.input_scale
    for k, row in enumerate(np.eye(len(scale))):
        found[3 + k] = way(lambda x, row=row: (robot, rest.inputs + x * scale * row))
    if near.n_built:
        first = 3 + len(scale)
        found[first] = way(lambda x: (_turned(robot, x), rest.inputs))
        # To one side: the hinges stand along the stiff direction.
        found[first + 1] = way(lambda x: (_uneven(robot, x, 0.0), rest.inputs), 1e-12)
        found[first + 2] = way(lambda x: (_uneven(robot, x, np.pi / 4), rest.inputs), 1e-12)
    true = np.array(list(found.values()))
    np.testing.assert_allclose(ways[list(found)], true, atol=3e-3 * np.abs(true).max())


@pytest.mark.parametrize("stiffer", [0.0, 0.2])
def test_a_weight_and_a_stiffness_change_the_first_modes(stiffer):
    """About a bent rest, against those of the chain of a robot that has them."""
    statics, weight, point = ChainStatics(RIG), 0.2, np.array([0.08, 0.0])
    near, place = Neighbourhood(statics, 0.02), Motion(point, *np.zeros((2, 2)))
    unknown = DifferenceFilter(3, near.n_built, 1.0, 1.0, 0.02).begin()
    mean = np.array([stiffer, 0.0, weight, *unknown.mean[3:]])
    rest = statics.hold(point, statics.begin(np.zeros(3)), True)
    found = near.about(rest, place, unknown._replace(mean=mean), None)
    other = ChainStatics(_heavier(RIG, weight * near.mass).vary(youngs_modulus=1 + stiffer))
    true = other.hold(point, other.begin(np.zeros(3)), True)
    linear = linearised(other.inverse, true.inputs)
    rates = np.log(np.linalg.eigvals(found.free).astype(complex)) / 0.02
    first = np.sort(np.abs(rates))[:4:2]  # each with its conjugate
    np.testing.assert_allclose(first, 2 * np.pi * linear.frequencies[:2], rtol=0.01)
    np.testing.assert_allclose(found.rest.inputs, true.inputs, atol=1e-3 * RIG.drive.travel)


def test_foretold_motions_are_those_of_a_moving_chain():
    """A push in fast laps, near the first frequency: what it changes, by the scene's steps."""
    statics, period, turn = ChainStatics(RIG), 0.02, 5.0
    near, mode = Neighbourhood(statics, period), np.zeros((8, 1))
    unknown = DifferenceFilter(3, near.n_built, 1.0, 1.0, period).begin()
    rest, before = statics.begin(np.zeros(3)), None
    scene, push = build_scene(model_scene(RIG)), np.array([0.02, 0.0, 0.0])
    foretold, actions = [], []
    policy, state, action = InverseDynamics(RIG, period), None, np.zeros(3)
    for k in range(150):
        names = "reference", "reference_velocity", "reference_acceleration"
        asked = dict(zip(names, _lap(turn, k * period), strict=True))
        action, state = policy.predict({**asked, "previous_action": action}, state)
        motion = Motion(*_lap(turn, (k + 0.5) * period))
        rest = statics.hold(motion.position, rest, k == 0)
        before = near.about(rest, motion, unknown, before)
        mode, moved = before.later(mode, before.by_inputs @ push[:, None])
        foretold.append(moved[0])
        actions.append(action)
    held = round(period / scene.config.control_period)
    commands = np.repeat(actions, held, axis=0) * statics.inputs.input_scale
    tips = [
        scene.tip(scene.simulate(150 * period, commands + more, samples=period).q)[1:, :2]
        for more in (0.0, push * statics.inputs.input_scale)
    ]
    seen = tips[1] - tips[0]
    wrong = np.linalg.norm(np.array(foretold) - seen, axis=1)
    assert wrong.max() < 0.1 * np.linalg.norm(seen, axis=1).max()


def _tip(statics, robot, inputs):
    """Of another robot that gets the same commands, in the coordinates of a reference."""
    scene = build_scene(model_scene(robot))
    return scene.tip(scene.equilibrium(statics.inverse.controls(inputs)))[statics.axes(2)]


def _turned(robot, angle):
    """With its tendons turned."""
    return replace(robot, tendons=tuple(tendon.turned(angle) for tendon in robot.tendons))


def _uneven(robot, share, azimuth):
    """Stiffer towards an azimuth by half of a share, softer across."""
    return replace(robot, anisotropy=share, stiff_azimuth=azimuth)


def _lap(turn, time):
    """Place, velocity and acceleration (2,) on a circle that grows to 80 mm in two seconds."""

    def place(t):
        share = np.clip(t / 2, 0.0, 1.0)
        z = 0.08 * share**3 * (10 - 15 * share + 6 * share**2) * np.exp(1j * turn * t)
        return np.array([z.real, z.imag])

    step = 1e-3
    before, now, after = (place(time + x) for x in (-step, 0.0, step))
    return now, (after - before) / (2 * step), (after - 2 * now + before) / step**2
