"""What can be trained, by the name of the policy that acts on it.

A training writes one file, of one robot, where policies look for it (`artifacts.find_artifact`).
What it needs is loaded when it runs.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from statistics import median
from typing import Any

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.core.interfaces import ProgressCallback
from softrobot_env.core.registry import VARIANTS, Registry, load
from softrobot_env.robots import RobotParams, entry_of

from .request import WARP, Metrics, Quantity, Training, TrainingRequest

#: The last operating points, by robot, plant and whether they are few.
_FOUND: dict[tuple[RobotParams, str, bool], Any] = {}


def quantity_mm(length: float) -> Quantity:
    """A length [m], shown in mm."""
    return Quantity(float(length), ".3f", "mm")


def _network(request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Network of the statics, one of places."""
    from .quasi_static import Learning, train

    how = Learning(samples=400, iterations=20) if "quick" in request.settings else None
    trained = train(request.robot, request.seed, show, how)
    trained.network.save(request.path, trained.about)
    off = trained.errors
    return [
        ("median error of the tip at rest, unseen places", quantity_mm(float(median(off)))),
        ("largest", quantity_mm(float(max(off)))),
        ("parameters", str(len(trained.network.parameters))),
    ]


def _fitting(
    name: str,
    general: Callable[[TrainingRequest, ProgressCallback], Metrics],
    request: TrainingRequest,
    show: ProgressCallback,
) -> Metrics:
    """What trains a policy of any robot, or what stands in for it for this one."""
    own = VARIANTS.find(f"training {name}", request.robot)
    return (general if own is None else load(own))(request, show)


def _table(design: str, request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Gains at operating points all over the workspace of a robot, by their design."""
    from softrobot_env.control.scheduled.law import build_table
    from softrobot_env.control.scheduled.policies import save_table

    robot, plant = request.robot, request.settings.get("plant", MUJOCO)
    points = _points(robot, plant, "quick" in request.settings, show)
    table = build_table(robot, load(design)(robot), points, partial(show, "gains"))
    save_table(request.path, table, robot, points.errors)
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


def _teachers_package(robot: RobotParams, settings: Mapping[str, Any]) -> tuple[str, ...]:
    """What the teacher of an imitation needs."""
    from softrobot_env.control.registry import find_policy

    package = find_policy(settings.get("teacher") or entry_of(robot).teacher, robot).package
    return () if package is None else (package,)


def _imitation(request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Network that imitates a policy; of the arm the model predictive one with preview."""
    from .artifacts import figures, save
    from .imitation import ImitationSetup, imitate, settings_of

    setup = ImitationSetup.of(request.robot, request.settings.get("teacher"), request.folder)
    config = settings_of(setup, "quick" in request.settings)
    network, view = imitate(config, request.seed, show, setup), setup.view()
    save(network, request.path, request.seed, request.robot, view)
    return [("teacher", setup.teacher), *figures(network, robot=request.robot, view=view)]


def _reinforcement(
    algorithm: str, randomize: bool, request: TrainingRequest, show: ProgressCallback
) -> Metrics:
    """Network that learns by reward; its learning curve is written beside it."""
    from .rl import run

    return run(algorithm, _randomized(request, randomize), show)


def check_reinforcement(name: str, request: TrainingRequest) -> None:
    """Refuse what a training of `LEARNERS` would refuse, before any work is done.

    Raises:
        ValueError: A setting that does not exist or is out of range, or no network to start from.
    """
    from .rl import check_request

    algorithm, randomize = LEARNERS[name]
    check_request(algorithm, _randomized(request, randomize))


def _randomized(request: TrainingRequest, randomize: bool) -> TrainingRequest:
    if not randomize:
        return request
    return replace(request, settings={"randomize": True, **request.settings})


def _run_by_path(path: str, request: TrainingRequest, show: ProgressCallback) -> Metrics:
    return load(path)(request, show)


#: Policies that act on a table of gains -> the design of the gains.
_TABLES = {
    "lqi": "softrobot_env.control.scheduled.lqi:Integral",
    "lq_preview": "softrobot_env.control.scheduled.lq_preview:Preview",
    "mpc": "softrobot_env.control.scheduled.policies:WithoutPreview",
    "mpc_preview": "softrobot_env.control.scheduled.mpc:Constrained",
}

#: Settings of reinforcement learning, see `commands.train`.
REINFORCEMENT = (
    *("task", "start", "randomize", "steps", "set", "checkpoint", "resume", "log"),
    *("backend", "device"),
)

#: Trainings by reinforcement: algorithm, and whether robots and disturbances are sampled.
LEARNERS = {name: (name, False) for name in ("ppo", "sac", "td3")} | {
    f"{name}_randomized": (name, True) for name in ("ppo", "sac")
}

#: Name of the policy and its file -> how to make it.
TRAININGS: Registry[Training] = Registry(
    "training",
    {
        "qs_nn": Training(partial(_fitting, "qs_nn", _network), ("quick",)),
        **{
            name: Training(
                partial(_fitting, name, partial(_table, design)),
                ("quick",),
                ("daqp",) if name.startswith("mpc") else (),
                is_random=False,
            )
            for name, design in _TABLES.items()
        },
        "ssm": Training(
            partial(_run_by_path, "softrobot_env.training.ssm:run"), ("twin", "recording", "quick")
        ),
        "sensors": Training(
            partial(_run_by_path, "softrobot_env.training.sensors:run"), ("twin", "quick")
        ),
        "imitation": Training(_imitation, ("teacher", "quick"), ("torch",), also=_teachers_package),
        **{
            name: Training(
                partial(_reinforcement, *how),
                ("quick", *REINFORCEMENT),
                ("torch", "stable_baselines3"),
                also=lambda robot, given: (WARP,) if given.get("backend") == "warp" else (),
            )
            for name, how in LEARNERS.items()
        },
    },
)


def register_training(
    name: str,
    run: Callable[[TrainingRequest, ProgressCallback], Metrics] | str,
    robot: RobotParams | None = None,
    *,
    replace: bool = False,
    **facts: Any,
) -> None:
    """Add a training, by the name of the policy that acts on what it makes.

    Args:
        name: Its name.
        run: Trains as asked, writes the file and returns what it found; or its path.
        robot: The only robot it is of; any unless given.
        replace: Whether it may take the place of another of this name.
        **facts: Others of `Training`.

    Raises:
        ValueError: The name is taken.
    """
    loaded = partial(_run_by_path, run) if isinstance(run, str) else run
    TRAININGS.register(name, Training(loaded, robot=robot, **facts), replace)
