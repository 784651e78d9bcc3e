"""What can be trained, by the name of the policy that acts on it.

A training writes one file, of one robot, where policies look for it (`artifacts.find_artifact`).
What it needs is loaded when it runs.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from statistics import median
from typing import Any

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.core.interfaces import ProgressCallback
from softrobot_env.core.registry import Registry, load
from softrobot_env.robots import ARM, RIG, RobotParams
from softrobot_env.training.request import (
    WARP,
    Metrics,
    Quantity,
    Training,
    TrainingRequest,
    usual_teacher,
)

#: The last operating points, by robot, plant and whether they are few.
_FOUND: dict[tuple[RobotParams, str, bool], Any] = {}


def _mm(length: float) -> Quantity:
    return Quantity(float(length), ".3f", "mm")


def _network(order: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Network of the statics: the thesis' of the arm (sec. 6.3), of other robots one of places."""
    if order.robot == ARM:
        return _thesis_network(order, show)
    from softrobot_env.training.quasi_static import Learning, train

    how = Learning(samples=400, iterations=20) if "quick" in order.settings else None
    trained = train(order.robot, order.seed, show, how)
    trained.network.save(order.path, trained.about)
    off = trained.errors
    return [
        ("median error of the tip at rest, unseen places", _mm(float(median(off)))),
        ("largest", _mm(float(max(off)))),
        ("parameters", str(len(trained.network.parameters))),
    ]


def _thesis_network(order: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Network of the quasi-static controller for the arm (thesis sec. 6.3)."""
    import numpy as np

    from softrobot_env.beams.closed_forms.constant_curvature import ConstantCurvatureStatics
    from softrobot_env.learned import bayesian, quasi_static
    from softrobot_env.learned.network import describe

    statics = ConstantCurvatureStatics(ARM)
    # Independent streams, so that the validation data are not those of another seed.
    streams = np.random.SeedSequence(order.seed).spawn(3)
    drawn, start, fresh = (np.random.default_rng(stream) for stream in streams)
    quick = "quick" in order.settings
    how = quasi_static.Sampling(pairs=500) if quick else quasi_static.Sampling()
    samples = quasi_static.sample(statics.tip, statics.n_inputs, how, drawn)

    def report(done: int, total: int, error: float) -> None:
        show(f"squared error {error:.4g}", done, total)

    network = samples.new_network(quasi_static.HIDDEN, start)
    fit = bayesian.train(network, samples, *((20,) if quick else ()), progress=report)
    validation = quasi_static.sample(statics.tip, statics.n_inputs, how, fresh)
    reached = quasi_static.workspace(samples.inputs[:, 2:4])
    fit.network.save(order.path, {**describe(ARM), "workspace": reached, "seed": order.seed})
    return [
        ("rms error, training data", Quantity(quasi_static.rms(fit.network, samples), ".4f", "N")),
        ("rms error, fresh data", Quantity(quasi_static.rms(fit.network, validation), ".4f", "N")),
        ("parameters", str(len(fit.network.parameters))),
        ("effective parameters", f"{fit.effective_parameters:.1f}"),
        ("alpha, beta", f"{fit.alpha:.4g}, {fit.beta:.4g}"),
        ("steps", f"{fit.iterations}{' (converged)' if fit.converged else ''}"),
    ]


def _gains(closed: str, design: str, order: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Gain table of a law, by its design; nothing in it is random.

    That of the arm is of the closed form (thesis sec. 6.4), those of other robots of their chain.
    """
    from softrobot_env.control.arm.timing import is_arm

    robot = order.robot
    if is_arm(robot):
        return _closed_gains(closed, order, show)
    return _table(design, order, show)


def _plan(design: str, order: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Table of a model predictive controller of any robot but planar arms, which need none."""
    from softrobot_env.control.scheduled.policies import is_planar_arm

    if is_planar_arm(order.robot):
        raise ValueError(
            f"robot {order.robot.name!r} is a planar arm, whose model predictive control is in "
            "closed form: there is nothing to train"
        )
    return _table(design, order, show)


def _table(design: str, order: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Gains at operating points all over the workspace of a robot, by their design."""
    from softrobot_env.control.scheduled.law import build_table
    from softrobot_env.control.scheduled.policies import save_table

    robot, plant = order.robot, order.settings.get("plant", MUJOCO)
    points = _points(robot, plant, "quick" in order.settings, show)
    made = load(design)(robot)
    table = build_table(robot, made, points, partial(show, "gains"))
    save_table(order.path, table, robot, points.errors)
    off = points.errors[-1] / robot.reach
    return [
        ("operating points", f"{len(points.points)} of {points.candidates} equilibria"),
        ("error of the tip between them", f"{100 * off:.3g} % of the reach"),
        ("gains per point", str(table.rows.shape[1])),
    ]


def _points(robot: RobotParams, plant: str, quick: bool, show: ProgressCallback) -> Any:
    """Operating points of a robot; those that were found last are kept for its other tables."""
    from softrobot_env.control.scheduled.operating_points import find_points

    asked = robot, plant, quick
    if asked not in _FOUND:
        size = {"most": 40, "candidates": 120} if quick else {}
        found = find_points(robot, progress=partial(show, "equilibria"), plant=plant, **size)
        _FOUND.clear()
        _FOUND[asked] = found
    return _FOUND[asked]


def _closed_gains(design: str, order: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Gain table of a law for the arm, by its design."""
    from softrobot_env.beams.closed_forms.planar_arm import make_planar_arm
    from softrobot_env.control.arm.operating_points import build_gains, save_gains

    robot = order.robot
    designed = partial(load(design), make_planar_arm(robot))
    gains = build_gains(robot, designed, partial(show, "operating points"))
    save_gains(order.path, robot, gains)
    return [
        ("operating points", " x ".join(str(count) for count in gains.shape[:3])),
        ("gains per point", str(gains.shape[3])),
    ]


def _backends_package(robot: RobotParams, settings: Mapping[str, Any]) -> tuple[str, ...]:
    """What the backend of a training needs."""
    return (WARP,) if settings.get("backend") == "warp" else ()


def _teachers_package(robot: RobotParams, settings: Mapping[str, Any]) -> tuple[str, ...]:
    """What the teacher of an imitation needs."""
    from softrobot_env.control.registry import find_policy

    package = find_policy(settings.get("teacher") or usual_teacher(robot)).package
    return () if package is None else (package,)


def _imitation(order: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Network that imitates a policy; of the arm the model predictive one with preview."""
    from softrobot_env.training.artifacts import figures, save
    from softrobot_env.training.imitation import ImitationSetup, imitate, settings_of

    lesson = ImitationSetup.of(order.robot, order.settings.get("teacher"), order.folder)
    config = settings_of(lesson, "quick" in order.settings)
    network, view = imitate(config, order.seed, show, lesson), lesson.view()
    save(network, order.path, order.seed, order.robot, view)
    return [("teacher", lesson.teacher), *figures(network, robot=order.robot, view=view)]


def _rig_network(order: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Identified parameters of a twin, for the rig's controllers (thesis sec. 5.1)."""
    from math import degrees

    from softrobot_env.identification.parameters import identified, parameters_of, record

    twin = order.settings.get("twin", 0)
    found = identified(record(twin, order.seed, show=show), order.seed, show=show)
    rig, errors = parameters_of(found, twin), found.networks.errors
    rig.save(order.path, RIG, {"seed": order.seed})
    return [
        ("twin", str(twin)),
        ("rms error, lengths of outputs", _mm(errors["inverse"])),
        ("rms error, outputs of lengths", _mm(errors["forward"])),
        ("bending stiffness over nominal", Quantity(rig.stiffness, ".3f")),
        ("bending damping over nominal", Quantity(rig.damping, ".3f")),
        ("turn of the tendons", f"{degrees(rig.turn):.2f} deg"),
        ("backlash of the tendons", _mm(rig.backlash)),
    ]


def _sensors(order: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Calibration of a robot's curvature sensors."""
    from softrobot_env.training.sensors import run

    return run(order, show)


def _reduced(order: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Reduced model of a robot as built, learned from its motion (thesis sec. 3.3)."""
    from softrobot_env.training.ssm import run

    return run(order, show)


def _reinforcement(
    algorithm: str, randomize: bool, order: TrainingRequest, show: ProgressCallback
) -> Metrics:
    """Network that learns by reward; its learning curve is written beside it."""
    from softrobot_env.training.rl import run

    return run(algorithm, _randomized(order, randomize), show)


def check_reinforcement(name: str, order: TrainingRequest) -> None:
    """Refuse what a training of `LEARNERS` would refuse, before any work is done.

    Raises:
        ValueError: A setting that does not exist or is out of range, or no network to start from.
    """
    from softrobot_env.training.rl import check_order

    algorithm, randomize = LEARNERS[name]
    check_order(algorithm, _randomized(order, randomize))


def _randomized(order: TrainingRequest, randomize: bool) -> TrainingRequest:
    return replace(order, settings={"randomize": True, **order.settings}) if randomize else order


#: Settings of reinforcement learning, see `commands.train_rl`.
REINFORCEMENT = (
    *("task", "start", "randomize", "steps", "set", "checkpoint", "resume", "log"),
    *("backend", "device"),
)

#: Trainings by reinforcement: algorithm, and whether robots and disturbances are drawn.
LEARNERS = {name: (name, False) for name in ("ppo", "sac", "td3")} | {
    f"{name}_randomized": (name, True) for name in ("ppo", "sac")
}

#: Name of the policy and its file -> how to make it.
TRAININGS: Registry[Training] = Registry(
    "training",
    {
        "qs_nn": Training(_network, ("quick",)),
        "lqi": Training(
            partial(
                _gains,
                "softrobot_env.control.arm.gains:lqi_design",
                "softrobot_env.control.scheduled.lqi:Integral",
            ),
            ("quick",),
            drawn=False,
        ),
        "lq_preview": Training(
            partial(
                _gains,
                "softrobot_env.control.arm.gains:preview_design",
                "softrobot_env.control.scheduled.lq_preview:Preview",
            ),
            ("quick",),
            drawn=False,
        ),
        "mpc": Training(
            partial(_plan, "softrobot_env.control.scheduled.policies:WithoutPreview"),
            ("quick",),
            ("daqp",),
            drawn=False,
        ),
        "mpc_preview": Training(
            partial(_plan, "softrobot_env.control.scheduled.mpc:Constrained"),
            ("quick",),
            ("daqp",),
            drawn=False,
        ),
        "rig_nn": Training(_rig_network, ("twin",), robot=RIG),
        "ssm": Training(_reduced, ("twin", "recording", "quick")),
        "sensors": Training(_sensors, ("twin", "quick")),
        "imitation": Training(_imitation, ("teacher", "quick"), ("torch",), also=_teachers_package),
        **{
            name: Training(
                partial(_reinforcement, *how),
                ("quick", *REINFORCEMENT),
                ("torch", "stable_baselines3"),
                also=_backends_package,
            )
            for name, how in LEARNERS.items()
        },
    },
)
