"""Many simulations of a gripper, each with a bar and fingers of its own."""

import warnings
from math import pi

import mujoco
import numpy as np

from softrobot_env.envs.config import EnvConfig
from softrobot_env.envs.simulation.batch import Batch
from softrobot_env.robots.gripper import Gripper
from softrobot_env.scene.assembly import FELT, build_assembly, felt_by
from softrobot_env.scene.chain import mean_curvature
from softrobot_env.scene.contacts import links_of
from softrobot_env.scene.gripper import Resolution, gripper_scene
from softrobot_env.scene.objects import Capsule
from softrobot_env.scene.timestep import TimestepWarning
from softrobot_env.tasks.gripper import GripTask

#: Name of the bar among objects.
BAR = "bar"

#: Its axis lies along y.
_ACROSS = (-pi / 2, 0.0, 0.0)

#: [m], how far above its seat a free bar starts.
_GAP = 1e-4


def bar(gripper: Gripper, task: GripTask, diameter: float, **look: tuple[float, ...]) -> Capsule:
    """The bar of a task, where it lies between straight fingers."""
    return Capsule(
        name=BAR,
        radius=diameter / 2,
        length=task.length,
        turn=_ACROSS,
        mass=float(np.mean(task.mass)) if task.free else None,
        position=(0.0, 0.0, gripper.seat(diameter / 2) + _GAP * task.free),
        **look,
    )


class GripperBatch(Batch):
    """Simulations of a gripper.

    The pairs' stiffness is that of the bar of mean mass.

    Attributes:
        gripper, task: What they are of.
        bends: (nq, pieces) [1/m], from hinge angles to mean curvatures of all fingers' pieces.
    """

    def __init__(
        self,
        gripper: Gripper,
        task: GripTask,
        config: EnvConfig,
        fineness: Resolution,
        felt_along: bool = False,
    ) -> None:
        """Build the simulations.

        Args:
            gripper, task: What they are of.
            config: Number, threads, and pieces and timestep unless the fineness says them.
            fineness: How fine they are.
            felt_along: As of `gripper_scene`.
        """
        self.gripper, self.task = gripper, task
        nominal = bar(gripper, task, float(np.mean(task.diameter)))
        scene = gripper_scene(
            gripper,
            (nominal,),
            contacts=fineness.contacts,
            control_period=config.control_period,
            pieces=config.pieces or fineness.pieces_of(gripper),
            timestep=config.timestep,
            felt_along=felt_along,
        )
        built = build_assembly(scene)
        if config.timestep is None and fineness.longer > 1:
            longer = fineness.longer * built.timestep.timestep
            with warnings.catch_warnings():  # of what was asked for
                warnings.simplefilter("ignore", TimestepWarning)
                built = build_assembly(scene.with_timestep(longer))
        super().__init__(built, config.num_envs, config.threads)
        model, expand = built.model, self._batch.expand
        self._body, self._geom = model.body(BAR).id, model.geom(f"{BAR}_shape").id
        self._pairs = [k for k in range(model.npair) if self._geom in _geoms(model, k)]
        self._size, self._bound, self._box = map(expand, ("geom_size", "geom_rbound", "geom_aabb"))
        self._mass, self._inertia = expand("body_mass"), expand("body_inertia")
        self._place, self._friction = expand("body_pos"), expand("pair_friction")
        self._springs, self._dampers = expand("jnt_stiffness"), expand("dof_damping")
        self._arms, self.gravity = expand("wrap_prm"), expand("opt.gravity")
        self._forces = self._batch.bind("xfrc_applied")
        self._measure()

    def _measure(self) -> None:
        scene, parts = self.scene, self.scene.parts.values()
        rows = []
        for part in parts:
            own = mean_curvature(
                part.scene.model, part.scene.layout, part.scene.config.robot.pieces
            )
            row = np.zeros((len(own), scene.model.nq))
            row[:, part.q] = own
            rows.append(row)
        self.bends = np.concatenate(rows).T
        places = [scene.model.sensor(f"{name}/{FELT}").adr[0] for name in scene.parts]
        self._felt = np.array(places)[:, None] + np.arange(3)
        self._links = [links_of(scene.model, part.member.prefix) for part in parts]
        self._pressed: dict[int, np.ndarray] = {}

    @property
    def curvature(self) -> np.ndarray:
        """(n, pieces) [1/m], means over the pieces of all fingers in turn."""
        return self.qpos @ self.bends

    @property
    def felt(self) -> np.ndarray:
        """(n, fingers, 3) [N], force of each finger on the bar."""
        return self.sensordata[:, self._felt]

    def pressed(self, finger: int) -> np.ndarray:
        """(n, links, 3) [N], force of each link of a finger on the bar.

        Raises:
            KeyError: The scene was not built with `felt_along`.
        """
        if finger not in self._pressed:
            first = [self.scene.model.sensor(felt_by(geom)).adr[0] for geom in self._links[finger]]
            self._pressed[finger] = np.array(first)[:, None] + np.arange(3)
        return self.sensordata[:, self._pressed[finger]]

    def links(self, finger: int) -> np.ndarray:
        """(links, 2) [m], between which arc lengths each link of a finger lies."""
        return np.array(list(self._links[finger].values()))

    @property
    def place(self) -> np.ndarray:
        """(n, 3) [m], of the bar."""
        if self.task.free:
            return self.qpos[:, -7:-4].copy()
        return self._place[:, self._body].copy()

    def start(self, which: np.ndarray, sampled: dict[str, np.ndarray]) -> None:
        """Start simulations `which` (k,), fingers straight, with what is sampled.

        Args:
            which: (k,) int, increasing.
            sampled: By names out of `tasks.gripper.DRAWN`, (k,) or of fingers (k, fingers).
        """
        radius = sampled["diameter"] / 2
        self._shape(which, radius, sampled["mass"])
        for pair in self._pairs:
            self._friction[which, pair, :2] = sampled["friction"][:, None]
        self._make_fingers(which, sampled["modulus"], sampled["arm"])
        heights = np.array([self.gripper.seat(r) + _GAP * self.task.free for r in radius])
        q = np.tile(self.scene.model.qpos0, (len(which), 1))
        if self.task.free:
            q[:, -5] = heights
        self._place[which, self._body, 2] = heights
        self._batch.set_const(which)
        self.reset(which, q, np.zeros((len(which), self.scene.model.nu)))

    def _shape(self, which: np.ndarray, radius: np.ndarray, mass: np.ndarray) -> None:
        half, geom = self.task.length / 2, self._geom
        self._size[which, geom, 0] = radius
        self._bound[which, geom] = radius + half
        self._box[which, geom, 3:5] = radius[:, None]
        self._box[which, geom, 5] = radius + half
        if self.task.free:
            self._mass[which, self._body] = mass
            self._inertia[which, self._body] = _inertia(mass, radius, 2 * half)

    def _make_fingers(self, which: np.ndarray, modulus: np.ndarray, arm: np.ndarray) -> None:
        model, tendon = self.scene.model, 0
        for k, part in enumerate(self.scene.parts.values()):
            joints = model.dof_jntid[part.v]
            stiff = modulus[:, k, None]
            self._springs[np.ix_(which, joints)] = model.jnt_stiffness[joints] * stiff
            self._dampers[which, part.v] = model.dof_damping[part.v] * stiff
            count = len(part.scene.config.robot.tendons)
            wraps = np.concatenate([_wraps(model, tendon + t) for t in range(count)])
            self._arms[np.ix_(which, wraps)] = model.wrap_prm[wraps] * arm[:, k, None]
            tendon += count

    def push(self, forces: np.ndarray, accelerations: np.ndarray) -> None:
        """Pull at the bars by forces (n, 3) [N], and accelerate the palms by (n, 3) [m/s2].

        In the axes of a palm that accelerates, everything feels the opposite: from the second
        timestep of the next period on, as the first takes the gravity with which it was prepared.
        """
        self._forces[:, 6 * self._body : 6 * self._body + 3] = forces
        self.gravity[:] = np.array(self.gripper.gravity) - accelerations


def _geoms(model: mujoco.MjModel, pair: int) -> tuple[int, int]:
    return model.pair_geom1[pair], model.pair_geom2[pair]


def _wraps(model: mujoco.MjModel, tendon: int) -> np.ndarray:
    first = model.tendon_adr[tendon]
    return np.arange(first, first + model.tendon_num[tendon])


def _inertia(mass: np.ndarray, radius: np.ndarray, length: float) -> np.ndarray:
    """(k, 3) [kg m2] of uniform capsules: a cylinder, and half a ball on each end."""
    ball = mass * (4 / 3 * radius) / (length + 4 / 3 * radius)
    rod = mass - ball
    along = rod * radius**2 / 2 + ball * 2 / 5 * radius**2
    across = rod * (radius**2 / 4 + length**2 / 12)
    across += ball * (2 / 5 * radius**2 + length**2 / 4 + 3 / 8 * length * radius)
    return np.stack([across, across, along], axis=1)
