"""Feedback of a late tip, on a plant of one mode whose motion is known exactly."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from softrobot_env.control.feedforward.differences import DifferenceFilter
from softrobot_env.control.feedforward.feedback import Feedback
from softrobot_env.control.feedforward.statics import ChainStatics, Rest
from softrobot_env.robots import ARM, EQUIVALENT_RIG, RIG, find_robot

TRUNK = find_robot("hanging_trunk")

FREQUENCY, DAMPING_TIME = 7.0, 0.07  # rad/s, s
REST = Rest(np.zeros(1))
AWAY = 3.0  # m per share that the robot is softer
SCALE = 20.0  # m, by a full scale of the input


def statics():
    """Of a robot whose input is its tip's place."""
    return SimpleNamespace(
        first_mode=lambda: (FREQUENCY, DAMPING_TIME),
        shifted=lambda rest, change, stiffer=0.0: (change + AWAY * stiffer, False),
        ways=lambda rest, size, stiffer: np.array([[SCALE], [-AWAY], [0.0]]),
        inputs=SimpleNamespace(n_inputs=1, input_scale=np.array([SCALE]), input_centre=np.zeros(1)),
    )


def errors(period, delay, offset=1.0, duration=20.0, told=None, **more):
    """Tips (n,) that should be at 0 but are pulled `offset` away, and the last state."""
    square = FREQUENCY**2
    rates = np.array([[0, 1, 0], [-square, -DAMPING_TIME * square, square], [0, 0, 0]])
    move = expm(period * rates)
    feedback = Feedback(
        statics(), period, tip_delay=delay * period if told is None else told, **more
    )
    felt, state, seen = feedback.start(np.zeros(1)), np.zeros(3), [0.0] * (delay + 1)
    for _ in range(round(duration / period)):
        tip = np.array([seen[-1 - delay]])
        state[2:], felt, _ = feedback.added(REST, np.zeros(1), tip, felt)
        state[2] += offset
        state = move @ state
        seen.append(state[0])
    return np.array(seen), felt


@pytest.mark.parametrize("learning", [None, RIG])
@pytest.mark.parametrize(("period", "delay"), [(0.02, 0), (0.02, 1), (0.01, 4), (0.05, 2)])
def test_the_tip_comes_to_rest_however_late_it_is_seen(period, delay, learning):
    seen, _ = errors(period, delay, learning=learning)
    assert np.abs(seen[-20:]).max() < 1e-2


def test_gains_that_are_not_told_of_the_delay_are_unstable():
    seen, _ = errors(0.02, 4, told=0.0)
    assert np.abs(seen[-20:]).max() > 1.0


def test_what_is_learned_holds_the_tip_where_it_was_not_yet():
    """An offset and a softer spring pull alike at one place, and are told apart by two."""
    kept = DifferenceFilter(1, reach=1.0, frequency=5.0, period=0.02)
    true, found = np.array([0.03, -0.2, 0.0]), kept.begin()
    for k in range(4000):
        place = np.sin(0.05 * k)
        ways = np.array([[2.0], [-3.0 * place], [0.0]])
        found = kept.updated(found, -ways.T @ true, ways)
    np.testing.assert_allclose(found.mean, true, atol=2e-3)


def test_unknowns_that_are_not_seen_stay_as_unknown_as_they_were():
    kept = DifferenceFilter(2, reach=1.0, frequency=5.0, period=0.02)
    before = kept.begin()
    after = kept.updated(before, np.zeros(2), np.zeros((4, 2)))
    assert (np.diag(after.covariance) > np.diag(before.covariance)).all()
    np.testing.assert_array_equal(after.mean, before.mean)


def _heavier(robot, mass):
    """With a mass [kg] more at the tip."""
    head = robot.head
    whole = head.mass + mass
    centre = (head.mass * head.centre + mass * head.output) / whole
    return replace(robot, head=replace(head, mass=whole, centre=centre))


@pytest.mark.parametrize(
    ("robot", "place"), [(EQUIVALENT_RIG, (0.05, 0.03)), (ARM, (0.2, 0.4)), (TRUNK, (0.05, -0.04))]
)
def test_ways_are_those_of_equilibria_of_robots_that_differ(robot, place):
    """Against the tips of other chains under the same inputs, by differences to both sides."""
    statics, step = ChainStatics(robot), 1e-4
    rest = statics.hold(np.array(place), statics.begin(statics.inputs.input_centre), True)
    ways = statics.ways(rest, len(place))

    def tip(own, inputs):
        other = ChainStatics(own).inverse
        place = other.place(inputs)
        return other.tip(place.posture)[statics.axes(2)]

    def way(changed):
        above, below = changed(step), changed(-step)
        return (tip(*above) - tip(*below)) / (2 * step)

    scale = statics.inputs.input_scale
    found = [
        way(lambda x, row=row: (robot, rest.inputs + x * scale * row)) for row in np.eye(len(scale))
    ]
    found.append(way(lambda x: (robot.vary(youngs_modulus=1 + x), rest.inputs)))
    if robot.head is not None:
        mass = statics.scene.model.body_mass.sum()
        found.append(way(lambda x: (_heavier(robot, x * mass), rest.inputs)))
    np.testing.assert_allclose(ways[: len(found)], found, atol=2e-3 * np.abs(found).max())
