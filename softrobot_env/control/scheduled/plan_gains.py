"""Gains of plans: optimal future actions for a known reference, and the cost of deviations."""

import numpy as np
from numpy import ndarray
from numpy.linalg import norm, solve
from scipy.linalg import solve_discrete_are

from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs

from ..linear_quadratic import discretized, hats
from .operating_points import Equilibrium
from .timing import Timing

#: Weights of the cost sum_k (|e|^2 + (s T)^2 |e.|^2 + i g^2 |a|^2 + r g^2 T^2 |a.|^2), with e the
#: tip's distance [m] from the reference, T the period of the first mode, a the actions' distance
#: from those that hold it, and g [m] how far an action of one moves the tip at rest.
_VELOCITY_WEIGHT, _INPUT_WEIGHT = 7e-4, 5e-3  # s^2 and i

#: r: its value where tensions follow at once, and its factor on the square of (reach / T) over the
#: speed at which the drives move the tip.
_RATE_WEIGHT, _SLOW_WEIGHT = 1e-7, 5e-4


class Regulator:
    """An LQ problem with N states, including the m actions, whose inputs change the actions.

    x+ = A x + B v costs x'Qx + v'Rv. P solves Riccati's equation, W = (R + B'PB)^-1 B',
    K = W P A and A_c = A - B K.

    Attributes:
        size: (2 n,), of the states before the actions, in their own units.
        a, b, weight, change: A (N, N), B (N, m), Q (N, N) and R (m, m).
        position, speed: (d, N), outputs that follow the reference, and their rates.
        velocity_weight: [s2], of errors of the rates.
        riccati, gain, feedback: P (N, N), W (m, N) and K (m, N).
    """

    def __init__(
        self,
        size: ndarray,
        system: tuple[ndarray, ndarray],
        outputs: tuple[ndarray, ndarray],
        velocity_weight: float,
        weights: tuple[ndarray, ndarray],
    ) -> None:
        """Solve Riccati's equation of a system (A, B), outputs (position, speed) and (Q, R)."""
        self.size, self.velocity_weight = size, velocity_weight
        self.a, self.b = system
        self.position, self.speed = outputs
        self.weight, self.change = weights
        self.riccati = solve_discrete_are(self.a, self.b, self.weight, self.change)
        self.gain = solve(self.change + self.b.T @ self.riccati @ self.b, self.b.T)
        self.feedback = self.gain @ self.riccati @ self.a


def regulator_of(
    robot: RobotParams, point: Equilibrium, directions: ndarray, timing: Timing
) -> Regulator:
    """The tracking problem at an operating point, from which laws of any robot are designed.

    Args:
        robot: The robot, whose drive speed is used.
        point: The operating point.
        directions: (d, 3), see `Table`.
        timing: Of the law.
    """
    n, (period, first) = len(point.curvature), (timing.period, timing.first)
    continuous_a, continuous_b, tip = point.model.state_space()
    size = np.repeat([1.0, 1 / first], n)  # of states, so that they are of similar size
    a, b = discretized(continuous_a * size / size[:, None], continuous_b / size[:, None], period)
    m = b.shape[1]
    a = np.block([[a, b], [np.zeros((m, 2 * n)), np.eye(m)]])
    b = np.vstack([b, np.eye(m)])
    place = directions @ tip
    position = np.hstack([place * size, np.zeros((len(place), m))])
    speed = np.hstack([np.zeros((len(place), n)), place[:, :n] / first, np.zeros((len(place), m))])
    gain = norm(place[:, :n] @ point.by_action) / np.sqrt(len(place))  # m
    weight = position.T @ position + _VELOCITY_WEIGHT * first**2 * speed.T @ speed
    weight[2 * n :, 2 * n :] += _INPUT_WEIGHT * gain**2 * np.eye(m)
    # Riccati's equation needs every state in the cost; this weight is negligible.
    weight += 1e-10 * np.trace(weight) / len(weight) * np.eye(len(weight))
    tip_speed = gain * robot.drive.speed / robot_inputs(robot).input_scale.max()  # m/s
    rate_weight = _RATE_WEIGHT + _SLOW_WEIGHT * (robot.reach / first / tip_speed) ** 2
    change = rate_weight * (gain * first / period) ** 2 * np.eye(m)
    velocity_weight = _VELOCITY_WEIGHT * first**2
    return Regulator(size, (a, b), (position, speed), velocity_weight, (weight, change))


def plan_gains(regulator: Regulator, timing: Timing, directions: ndarray) -> ndarray:
    """Gains [K (c m, 2 n + m), G (c m, knots, 3)], flattened, of the actions at the nodes.

    The actions are a- - K (x, a-) + sum_i G_i way_i, with x and a- the state and the current
    actions relative to the moving equilibrium, if the optimal law acts until each node. With p of
    the reference r from p_k = A_c' p_k+1 + C' r_k, the optimal inputs are v_k = -K x_k + W p_k+1.
    Between the times at which the reference is known it is interpolated linearly; after the last it
    is constant.

    Args:
        regulator: The problem at an operating point, in the directions.
        timing: Of the law.
        directions: (d, 3).
    """
    ahead, nodes = costates(regulator, timing), _periods(timing, timing.nodes)
    a, b, size = regulator.a, regulator.b, regulator.size
    count, m = b.shape
    states = np.eye(count, count + ahead.shape[2])
    plan = []
    for k in range(nodes[-1]):
        by_reference = np.hstack(
            [np.zeros((m, count)), regulator.gain @ ahead[min(k, len(ahead) - 1)]]
        )
        states = a @ states + b @ (by_reference - regulator.feedback @ states)
        if k + 1 in nodes:
            plan.append(states[-m:])
    plan = np.concatenate(plan)
    feedback = np.tile(np.eye(m, count, count - m), (len(nodes), 1)) - plan[:, :count]
    feedback /= np.concatenate([size, np.ones(m)])
    references = plan[:, count:].reshape(len(plan), len(timing.knots), len(directions)) @ directions
    return np.concatenate([feedback.ravel(), references.ravel()])


def deviation_cost(regulator: Regulator, timing: Timing) -> ndarray:
    """H (c m, c m): half the second derivative of the cost by the actions at the nodes.

    The actions deviate from the optimal ones by straight lines between the nodes, and after the
    last one the optimal law continues from the resulting state. The additional cost is quadratic,
    as the first derivative vanishes at the optimum. The diagonal is one on average.
    """
    nodes, m = _periods(timing, timing.nodes), regulator.b.shape[1]
    steps = np.arange(nodes[-1] + 1)
    off = np.kron(hats(nodes[-1], timing.nodes, timing.period), np.eye(m)).reshape(
        len(steps), m, -1
    )
    states, cost = np.zeros((len(regulator.a), off.shape[2])), 0.0
    for k in range(nodes[-1]):
        change = off[k + 1] - off[k]
        states = regulator.a @ states + regulator.b @ change
        last = k + 1 == nodes[-1]
        weight = regulator.riccati if last else regulator.weight
        cost = cost + change.T @ regulator.change @ change + states.T @ weight @ states
    cost = (cost + cost.T) / 2
    return cost * len(cost) / np.trace(cost)


def _periods(timing: Timing, times: tuple[float, ...]) -> list[int]:
    return [round(time / timing.period) for time in times]


def costates(regulator: Regulator, timing: Timing) -> ndarray:
    """(steps + 1, N, k d): p_1, p_2 and so on by the reference at the knots; the last stays."""
    count, outputs = len(regulator.a), len(regulator.position)
    closed = regulator.a - regulator.b @ regulator.feedback
    if not timing.knots:
        return np.zeros((1, count, 0))
    steps = _periods(timing, timing.knots)[-1]
    by_knot = np.kron(hats(steps, timing.knots, timing.period), np.eye(outputs))
    places = by_knot.reshape(steps + 1, outputs, -1)
    costate = solve(np.eye(count) - closed.T, regulator.position.T @ places[-1])
    found = [costate]
    for k in range(steps, 0, -1):
        costate = closed.T @ costate + regulator.position.T @ places[k]
        if k < steps:
            rate = (places[k + 1] - places[k - 1]) / (2 * timing.period)
            costate += regulator.velocity_weight * regulator.speed.T @ rate
        found.append(costate)
    return np.array(found[::-1])
