"""A robot of one joint on one tendon whose motor has a force: its motion by SciPy, piece by piece.

Joint: I a'' = arm T - D a' - K a. Motor: m u' = P - (1 + 2 a x) T - friction, where it turns, else
it sticks as long as the others are within its friction. P and T are written out from their
definitions; corners of theirs are left to the solver's steps, friction's changes are events.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class OneJoint:
    """Numbers of the joint, the wire and the motor, SI; `pretension` [N] is that of command 0."""

    inertia: float
    damping: float
    spring: float
    arm: float
    stiffness: float
    pretension: float
    seating: float
    mass: float
    gain: float
    velocity_gain: float
    limit: float
    friction: float
    layers: float = 0.0

    def wire(self, stretch):
        """Tension [N]."""
        if stretch <= 0:
            return 0.0
        if stretch < self.seating:
            return self.stiffness * stretch**2 / (2 * self.seating)
        return self.stiffness * (stretch - self.seating / 2)

    @property
    def seated(self):
        """Stretch [m] under the pretension."""
        if self.pretension >= self.stiffness * self.seating / 2:
            return self.pretension / self.stiffness + self.seating / 2
        return np.sqrt(2 * self.seating * self.pretension / self.stiffness)

    def tension(self, angle, x):
        """[N]"""
        return self.wire(self.seated + x + self.layers * x * x - self.arm * angle)

    def loop(self, command, x, u):
        """Force [N] of the position loop."""
        force = self.gain * (command - x) - self.velocity_gain * u
        return min(max(force, -self.limit), self.limit)

    def load(self, command, angle, x, u):
        """Force [N] on the motor but friction."""
        return self.loop(command, x, u) - (1 + 2 * self.layers * x) * self.tension(angle, x)

    def energy(self, command, angle, rate, x, u):
        """Kinetic energy, that of joint and wire, and of the loop's spring within its limit [J]."""
        stretch = max(self.seated + x + self.layers * x * x - self.arm * angle, 0.0)
        s = self.seating
        wire = stretch**3 / (6 * s) if stretch < s else (stretch**2 - s * stretch + s * s / 3) / 2
        error, reach = abs(command - x), self.limit / self.gain
        loop = error**2 / 2 if error < reach else reach * (error - reach / 2)
        moving = self.inertia * rate**2 + self.mass * u**2 + self.spring * angle**2
        return moving / 2 + self.stiffness * wire + self.gain * loop

    def motion(self, commands, period, state):
        """States (k, 4) of angle, rate, x and u after periods with commands (k,)."""
        states = []
        for command in commands:
            state = self._through(command, period, np.array(state, float))
            states.append(state)
        return np.array(states)

    def _through(self, command, period, state):
        time = 0.0
        while time < period * (1 - 1e-14):
            way = np.sign(state[3])
            if way == 0:
                free = self.load(command, state[0], state[2], 0.0)
                way = np.sign(free) if abs(free) > self.friction else 0.0
            time, state, stopped = self._until(command, way, time, period, state)
            if stopped:
                state[3] = 0.0
        return state

    def _until(self, command, way, time, period, state):
        def rates(_, y):
            angle, rate, x, u = y
            pull = self.tension(angle, x)
            turn = (self.arm * pull - self.damping * rate - self.spring * angle) / self.inertia
            if way == 0:
                return rate, turn, 0.0, 0.0
            return (
                rate,
                turn,
                u,
                (self.load(command, angle, x, u) - way * self.friction) / self.mass,
            )

        def stops(_, y):
            return way * y[3]

        def slips(_, y):
            return self.friction * (1 + 1e-12) - abs(self.load(command, y[0], y[2], 0.0))

        event = slips if way == 0 else stops
        event.terminal, event.direction = True, -1
        found = solve_ivp(
            rates, (time, period), state, "DOP853", rtol=1e-10, atol=1e-13, events=event,
            max_step=2e-4,
        )  # fmt: skip
        return found.t[-1], found.y[:, -1], found.status == 1
