"""A twin as hardware sees it: lengths in; lengths, forces, voltages and pictures out."""

from math import ceil

import numpy as np
from numpy import ndarray

from softrobot_env.robots.twin import Twin
from softrobot_env.scene.registry import RIG_PIECES
from softrobot_env.scene.servos import Servos

from ..observations.readouts import Camera
from ..reference import TOP
from .plants import MujocoPlant

#: Optical curvature sensors, one in each bending direction and sense: counts at rest, and counts
#: per curvature [m] over a span of 1930 of 4096 counts for the rig's usable range (S).
ADC_REST, ADC_SLOPE = 2048.0, 120.0
ADC_NOISE, _ADC_TOP = 1.4, 4095

#: Supply [V] of the servos.
SUPPLY = 6.0


class VirtualRig:
    """The simulated rig, or another robot driven by length, advanced a few milliseconds at a time.

    Attributes:
        tick: [s] of an `advance`.
        picture: Age [s] and tip (d,) [m] of the picture that became available in the last
            `advance`, or None.
        stuck: Indices of tendons whose servos are blocked; for tests.
    """

    def __init__(
        self,
        twin: Twin,
        tick: float = 0.001,
        seed: int = 0,
        axes: slice = TOP,
        pieces: int | None = RIG_PIECES,
    ) -> None:
        """A robot at rest, straight and pretensioned.

        Args:
            twin: The simulated twin, with its servos and camera.
            tick: [s].
            seed: Of the noise of camera and sensors.
            axes: Coordinates measured by the camera, among x, y and z.
            pieces: Of the chain; None chooses as many as it needs.
        """
        self.twin, self.tick = twin, tick
        self.picture: tuple[float, ndarray] | None = None
        self.stuck: set[int] = set()
        plant = MujocoPlant(twin.robot, tick, axes=axes, pieces=pieces)
        self._simulation = simulation = plant.simulation({})
        self._servos = Servos.of(twin, tick)
        start = np.zeros(len(twin.robot.tendons))
        self._servos.start(start)
        simulation.drive_by(self._servos)
        posture = plant.equilibrium(start + twin.rest_offset)
        simulation.reset(posture, self._servos.horn)
        self._readout = plant.readout(simulation, self._servos)
        late, self._rng = ceil(twin.camera_delay / tick - 1e-9), np.random.default_rng([seed, 1])
        self._camera = Camera(twin.camera_noise, late, tick, len(range(3)[axes]), seed)

    def advance(self, command: ndarray | None) -> str | None:
        """Advance by a tick.

        Args:
            command: (n,) [m], targets of the servos; None without power: then they stay.

        Returns:
            The failure, or None.
        """
        stay = self._servos.reading
        wanted = stay if command is None else np.array(command, float)
        for channel in self.stuck:
            wanted[channel] = stay[channel]
        self._servos.command[:] = wanted
        healthy = self._simulation.advance()
        outside = self._readout.update()
        new = self._camera.see(self.tip)
        self.picture = (self._camera.age, self._camera.position) if new else None
        return self._simulation.failure() if not healthy else outside

    @property
    def tip(self) -> ndarray:
        """Position of the tip, (d,) [m]."""
        return np.array(self._readout.tip)

    @property
    def length(self) -> ndarray:
        """Positions (n,) [m] of the servos, as read by their potentiometers."""
        return self._servos.reading

    @property
    def tension(self) -> ndarray:
        """(n,) [N]."""
        return self._readout.tendon_tension()

    def adc(self) -> tuple[int, ...]:
        """Counts of the four optical sensors."""
        beta, gamma = self._readout.bend[-2:]
        bent = np.array([beta, gamma, -beta, -gamma])
        counts = ADC_REST + ADC_SLOPE * bent + ADC_NOISE * self._rng.standard_normal(4)
        return tuple(int(c) for c in np.clip(np.rint(counts), 0, _ADC_TOP))
