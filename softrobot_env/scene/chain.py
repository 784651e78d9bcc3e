"""The backbone: rigid links between elastic hinges, with the beam's mass and stiffness."""

from dataclasses import dataclass

import mujoco
import numpy as np

from softrobot_env.robots import RobotParams
from softrobot_env.scene.quadrature import HingeLayout

#: Hinge axis of a planar robot: a positive angle bends +z towards +x.
PLANAR_AXIS = (0.0, 1.0, 0.0)

TIP_SITE = "tip"


@dataclass(frozen=True)
class Chain:
    """Bodies of the chain, to hang other parts on.

    Attributes:
        spec: The model under construction.
        layout: Where the hinges stand.
        length: [m] of the robot.
        bodies: World body, then one body per hinge.
    """

    spec: mujoco.MjSpec
    layout: HingeLayout
    length: float
    bodies: tuple[mujoco.MjsBody, ...]

    def locate(self, station: float) -> tuple[mujoco.MjsBody, float]:
        """Body that carries arc length `station` [m], and the height [m] above its origin.

        A station on a hinge belongs to the link above it.

        Raises:
            ValueError: The station is not on the robot.
        """
        if not 0 <= station <= self.length * (1 + 1e-12):
            raise ValueError(f"station must lie in [0, {self.length}] m, got {station}")
        index = int(np.searchsorted(self.layout.stations, station, side="right"))
        origin = self.layout.stations[index - 1] if index else 0.0
        return self.bodies[index], station - origin


def add_chain(spec: mujoco.MjSpec, robot: RobotParams, layout: HingeLayout) -> Chain:
    """Add the links, hinges and the tip site to an empty spec."""
    bodies = [spec.worldbody]
    stations = np.concatenate(([0.0], layout.stations, [robot.length]))
    for index, weight in enumerate(layout.weights):
        origin = stations[index + 1] - stations[index]
        body = bodies[-1].add_body(name=f"link{index}", pos=[0, 0, origin])
        _set_inertia(body, robot, stations[index + 2] - stations[index + 1])
        _add_hinge(body, f"hinge{index}", robot, weight)
        bodies.append(body)
    chain = Chain(spec, layout, robot.length, tuple(bodies))
    body, height = chain.locate(robot.length)
    body.add_site(name=TIP_SITE, pos=[0, 0, height], size=[1e-3, 0, 0])
    return chain


def _set_inertia(body: mujoco.MjsBody, robot: RobotParams, length: float) -> None:
    """Mass and inertia of a hollow cylinder of `length` [m] above the body's origin."""
    mass = robot.mass_per_length * length
    square = robot.outer_radius**2 + robot.inner_radius**2
    lateral = mass * (3 * square + length**2) / 12
    body.mass = mass
    body.ipos = [0, 0, length / 2]
    body.inertia = [lateral, lateral, mass * square / 2]
    body.explicitinertial = True


def _add_hinge(body: mujoco.MjsBody, name: str, robot: RobotParams, weight: float) -> None:
    """Hinge with the bending stiffness and damping of `weight` [m] of beam."""
    joint = body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=PLANAR_AXIS)
    stiffness = robot.bending_stiffness / weight
    joint.stiffness[0] = stiffness
    joint.damping[0] = robot.damping_time * stiffness
