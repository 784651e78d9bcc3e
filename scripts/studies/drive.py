"""Friction along tendons: tension, hysteresis, energy, cost, and policies that know of it."""

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import gymnasium
import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.control.feedforward.statics import ChainStatics
from softrobot_env.control.registry import make_policy
from softrobot_env.core.motion import State
from softrobot_env.rendering import figures
from softrobot_env.robots import CANTILEVER_WEAK, ROBOTS, RobotParams, Tendon, read_robot
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.tendons import FeedLine
from softrobot_env.robots.twin import with_real_drive
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.integration.zones import Zones
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.timestep import TimestepWarning
from studies.lab import Case, Record, Rows, Study, for_pictures, quantity, select, table
from studies.truths.capstan import HangingRod

#: Friction coefficient of the robots whose cost is measured, and on which policies are tried.
COEFFICIENT = 0.15

#: Way [1] of the reference in a control period, over the robot's length, that is a jump.
_JUMP = 0.05

_FILES = Path(__file__).parents[2] / "assets" / "robots"
_ROBOTS = ("planar_finger", "silicone_rod", "hanging_trunk", "gripper_finger", "ftdcr_v4")


@dataclass(frozen=True, kw_only=True)
class Row(Record):
    """What a case has shown.

    Attributes:
        kind: "capstan", "loop", "energy", "cost", "policy" or "compensation".
        case: What was measured.
        error: Of "capstan" that of a ratio of tensions, of "loop" the largest of the tip's angle
            over the width of the loop, of "energy" the largest growth over the most there was; of
            "policy" the mean distance from the reference over that of a policy which knows of no
            friction [1], and of "compensation" of one which knows nothing of a real drive, but for
            a period of the first mode after each jump.
        ideal, unknown, known: [m], the mean distance with an ideal drive, and with the real one of
            policies that know nothing of it and that do.
        cost: Processor time of a control period over that without friction [1].
        evaluations: Of forces in a control period, over those without friction [1].
        width: [rad] of a loop.
        tension, angle, exact: (n,) [N], [rad], of a loop at the drive and the tip.
    """

    kind: str
    case: str
    error: float | None = quantity("", ".2g", default=None)
    cost: float | None = quantity("", ".3g", default=None)
    evaluations: float | None = quantity("", ".3g", default=None)
    ideal: float | None = quantity("mm", ".3g", default=None)
    unknown: float | None = quantity("mm", ".3g", default=None)
    known: float | None = quantity("mm", ".3g", default=None)
    width: float | None = quantity("rad", ".3g", default=None)
    tension: tuple[float, ...] = for_pictures(())
    angle: tuple[float, ...] = for_pictures(())
    exact: tuple[float, ...] = for_pictures(())


# ---------------------------------------------------------------- rods

_LENGTH, _RADIUS, _DISTANCE, _PULL = 0.3, 0.006, 0.005, 8.0


def _rod(tendon: Tendon) -> RobotParams:
    return RobotParams(
        "rod",
        length=_LENGTH,
        outer_radius=_RADIUS,
        inner_radius=0.0,
        youngs_modulus=5e6,
        density=10.0,  # it swings fast
        damping_time=0.02,
        pieces=12,
        tendons=(tendon,),
    )


def _line(coefficient: float, **route: object) -> Tendon:
    return Tendon(
        "t", (_DISTANCE, 0.0), _LENGTH, 0, 60.0, friction_coefficient=coefficient, **route
    )


def _capstan(turned: float) -> Row:
    """Ratio of tensions from the drive to the last segment of an arc."""
    model = build_scene(SceneConfig(_rod(_line(0.3)))).model
    data = mujoco.MjData(model)
    data.qpos[:] = turned / model.nq
    mujoco.mj_kinematics(model, data)
    zones = Zones(model).exponents(data)[1:]
    exact = np.exp(-0.3 * abs(turned) * (len(zones) - 0.5) / len(zones))
    error = abs(float(np.exp(-zones.sum()) / exact - 1))
    return Row(kind="capstan", case=f"arc of {turned:g} rad", error=error)


def _loop(coefficient: float) -> Row:
    """A slow triangle of tension, with a smaller loop within, and the tip's angle."""
    robot = _rod(_line(coefficient))
    scene = build_scene(SceneConfig(robot, accuracy="0.01%"))
    bending = float(robot.backbone.bending(np.array([_LENGTH / 2]))[0])
    corners = _PULL * np.array([0.0, 1.0, 0.75, 0.95])
    times = np.array([0.0, 100.0, 125.0, 145.0])  # s, slow beside how the rod's damping lags
    asked = np.linspace(2.5, 145.0, 58)
    motion = scene.simulate(
        145.0, lambda t: np.array([np.interp(t, times, corners)]), samples=np.append(0.0, asked)
    )
    tension = np.interp(asked, times, corners)
    exact = HangingRod(_LENGTH, bending, _DISTANCE, coefficient)
    angle, truth = motion.q[1:].sum(axis=1), exact.tip_angles(tension)
    pulled = asked <= times[1]
    let_go = (asked > times[1]) & (asked <= times[2])
    width = (truth[let_go] - np.interp(tension[let_go], tension[pulled], truth[pulled])).max()
    return Row(
        kind="loop",
        case=f"mu {coefficient:g}",
        error=float(np.abs(angle - truth).max() / width),
        width=float(width),
        tension=tuple(tension.tolist()),
        angle=tuple(angle.tolist()),
        exact=tuple(truth.tolist()),
    )


# ---------------------------------------------------------------- energy


def _energy(seeds: range) -> Row:
    """Largest growth of the energy of random robots under constant commands, over its range."""
    worst = max(float(np.diff(x).max() / np.ptp(x)) for x in map(energies, seeds))
    return Row(kind="energy", case=f"{len(seeds)} random robots", error=worst)


def energies(seed: int) -> ndarray:
    """Of a random robot that swings under constant commands (101,) [J], what drives store too.

    Every second one is driven by length.
    """
    rng = np.random.default_rng(seed)
    actuation = ("tension", "length")[seed % 2]
    length = CANTILEVER_WEAK.length
    guides = tuple(length * np.sort(rng.uniform(0.1, 0.9, 3))) if rng.random() < 0.5 else ()
    tendons = tuple(
        Tendon(
            f"t{k}",
            (0.02 * np.cos(angle), 0.02 * np.sin(angle)),
            length,
            0,
            100.0,
            guides=guides,
            stiffness=2e3,
            pretension=rng.uniform(1, 20),
            friction_coefficient=rng.uniform(0, 0.5),
            feed_line=FeedLine(rng.uniform(0, 3), 0.1) if rng.random() < 0.5 else None,
        )
        for k, angle in enumerate((0.0, 2.1, 4.2))
    )
    damping = rng.uniform(0.0, 3e-3)
    robot = replace(CANTILEVER_WEAK, tendons=tendons, damping_time=damping)
    scene = build_scene(SceneConfig(robot, pieces=3, actuation=actuation, bending="spatial"))
    model = scene.model
    start = State(rng.normal(0, 0.1, model.nq), rng.normal(0, 1.0, model.nv))
    ctrl = rng.uniform(0, 20, 3) if actuation == "tension" else rng.uniform(0, 5e-3, 3)
    motion = scene.simulate(1.0, ctrl, start, samples=0.01)
    data, out = mujoco.MjData(model), []
    for q, v in zip(motion.q, motion.v, strict=True):
        data.qpos[:], data.qvel[:], data.ctrl[:] = q, v, ctrl
        mujoco.mj_forward(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        pull = data.actuator_force
        stored = ctrl @ data.ten_length[:3] if actuation == "tension" else pull @ pull / 2 / 2e3
        out.append(data.energy.sum() + stored)
    return np.array(out)


# ---------------------------------------------------------------- robots


def _robot(name: str, coefficient: float = 0.0) -> RobotParams:
    robot = ROBOTS[name] if name in ROBOTS else read_robot(_FILES / f"{name}.toml")
    rubbing = (replace(t, friction_coefficient=coefficient) for t in robot.tendons)
    return replace(robot, tendons=tuple(rubbing))


def _cost(name: str) -> Row:
    """Drives that swing at several frequencies, in turn with friction and without."""
    scenes = [_scene(_robot(name, mu)) for mu in (0.0, COEFFICIENT)]
    inputs = robot_inputs(scenes[0].config.robot)
    phases = np.random.default_rng(1).uniform(0, 6, inputs.n_inputs)
    actions = 0.5 * np.sin(np.arange(300)[:, None] * 0.02 * np.pi + phases)
    path = inputs.command(inputs.from_actions(actions))
    found = np.array([[_followed(scene, path) for scene in scenes] for _ in range(3)]).min(axis=0)
    cost, evaluations = found[1] / found[0]
    return Row(kind="cost", case=name, cost=float(cost), evaluations=float(evaluations))


def _scene(robot: RobotParams) -> Scene:
    bending = "planar" if robot.is_planar else "spatial"
    options = {"bending": bending, "torsion": robot.twists, "actuation": robot.drive.kind}
    return build_scene(SceneConfig(robot, control_period=0.02, **options))


def _followed(scene: Scene, path: ndarray) -> tuple[float, int]:
    """Processor time [s], and evaluations of the forces, along commands (k, nu)."""
    simulation = Simulation(scene)
    simulation.reset(scene.model.qpos0, path[0])
    begun = process_time()
    for commands in path:
        simulation.ctrl[:] = commands
        simulation.advance()
    return process_time() - begun, simulation.evaluations


def _policy(name: str) -> Row:
    """Inverse dynamics along the robot's own path, that know of friction or do not."""
    plain, rubbing = _robot(name), _robot(name, COEFFICIENT)
    return _compared("policy", plain, rubbing)


def _compensation(name: str) -> Row:
    """The same of the whole drive."""
    plain = _robot(name)
    return _compared("compensation", plain, with_real_drive(plain))


def _compared(kind: str, plain: RobotParams, real: RobotParams) -> Row:
    pairs = (plain, plain), (real, plain), (real, real)
    ideal, unknown, known = (_missed(*pair, settled=kind == "compensation") for pair in pairs)
    names = {"ideal": ideal, "unknown": unknown, "known": known}
    return Row(kind=kind, case=plain.name, error=known / unknown, **names)


def _missed(robot: RobotParams, nominal: RobotParams, settled: bool) -> float:
    """Mean distance [m] of a nominal robot's policy from the reference; or but for ways there."""
    task = "reach" if robot.name == "gripper_finger" else "circle"
    moves = ("reference", "reference_velocity", "reference_acceleration")
    seen = (*moves, "tip_position", "previous_action")
    env = gymnasium.make("SoftRobot/Track-v0", robot=robot, task=task, observe=seen)
    period = env.unwrapped.control_period
    policy = make_policy("chain_dynamics", nominal, period)
    (observation, _), state, missed, counts, left = env.reset(seed=0), None, [], [], 0.0
    first = 2 * np.pi / ChainStatics(robot).first_mode()[0] if settled else 0.0
    before = observation["reference"]
    for step in range(300):
        jump = np.linalg.norm(observation["reference"] - before) > _JUMP * robot.length
        left = first if jump or step == 0 else left - period
        before = observation["reference"]
        action, state = policy.predict(observation, state)
        observation, _, terminated, truncated, _ = env.step(action)
        missed.append(np.linalg.norm(observation["tip_position"] - observation["reference"]))
        counts.append(left <= 0)
        if terminated or truncated:
            break
    env.close()
    return float(np.mean(np.array(missed)[counts]))


# ---------------------------------------------------------------- the study


def cases(quick: bool) -> Iterable[Case]:
    """Of a kind with what is measured."""
    for turned in (0.5, -1.5, 3.0):
        yield {"kind": "capstan", "of": turned}
    for coefficient in (0.05, 0.2, 0.4):
        yield {"kind": "loop", "of": coefficient}
    yield {"kind": "energy", "of": range(2000, 2020 if quick else 3000)}
    for name in ("arm", *_ROBOTS)[: 3 if quick else None]:
        yield {"kind": "cost", "of": name}
    for kind in ("policy", "compensation"):
        for name in _ROBOTS[: 1 if quick else None]:
            yield {"kind": kind, "of": name}


_KINDS = {
    "capstan": _capstan,
    "loop": _loop,
    "energy": _energy,
    "cost": _cost,
    "policy": _policy,
    "compensation": _compensation,
}


def measure(case: Case) -> Row:
    """A case's row."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TimestepWarning)  # errors are measured here
        return _KINDS[case["kind"]](case["of"])


def _drawn(rows: Rows) -> figures.Figure | None:
    loops = select(rows, kind="loop")
    if not loops:
        return None
    figure, axes = figures.new_figure(1, len(loops), (3.2 * len(loops), 3.0))
    for axis, row in zip(axes.flat, loops, strict=True):
        axis.plot(row.tension, row.exact, color="0.6", linewidth=3, label="exact rod")
        axis.plot(row.tension, row.angle, ".", markersize=4, label="chain of 24 stations, moving")
        axis.set(title=row.case, xlabel="tension at the drive [N]", ylabel="tip's angle [rad]")
    worst = max(row.error for row in loops)
    return figures.finish(
        figure,
        axes.flat[0],
        f"Loops of a rod whose tendon rubs are within {100 * worst:.2g} % of their width",
    )


STUDY = Study(
    kinds=(Row,),
    cases=cases,
    measure=measure,
    label=lambda case: f"{case['kind']} {case['of']}",
    tables=[
        table("Tension from drive to tip", "case", "error", where={"kind": "capstan"}),
        table("Hysteresis loops", "case", "width", "error", where={"kind": "loop"}),
        table("Growth of energy", "case", "error", where={"kind": "energy"}),
        table("With friction over without", "case", "cost", "evaluations", where={"kind": "cost"}),
        table(
            "Inverse dynamics that know of friction, over those that do not",
            "case",
            "ideal",
            "unknown",
            "known",
            "error",
            where={"kind": "policy"},
        ),
        table(
            "The same of all of a real drive",
            "case",
            "ideal",
            "unknown",
            "known",
            "error",
            where={"kind": "compensation"},
        ),
    ],
    plots={"{}": _drawn},
    alone=True,
)
