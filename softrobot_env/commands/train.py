"""`softrobot train`: make the trained artifacts that policies load."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from time import perf_counter

from rich.console import Console
from rich.progress import Progress

from softrobot_env.artifacts import artifact_name
from softrobot_env.commands import train_rl
from softrobot_env.commands.arguments import add_robot, seed
from softrobot_env.interfaces import Show
from softrobot_env.paths import models_dir
from softrobot_env.registries import load
from softrobot_env.rendering.tables import named_values
from softrobot_env.robots import ARM, RIG, RobotParams, find_robot

EXAMPLE = """softrobot train --algo ppo --randomize
  softrobot train rig_nn --twin 3 --out out"""

#: What a training found, as pairs of a quantity and its value with unit.
Figures = list[tuple[str, str]]


@dataclass(frozen=True)
class Trainer:
    """How to make an artifact.

    Attributes:
        run: Train for a robot by seed (where anything is random), write the file and return the
            figures.
        packages: That it needs beyond the package's own, of the extras `rl` and `mpc`.
        robot: The only robot it is of, None of any.
    """

    run: Callable[[RobotParams, int, Path, Show], Figures]
    packages: tuple[str, ...] = ()
    robot: RobotParams | None = None


def _train_qs_nn(robot: RobotParams, seed: int, path: Path, show: Show) -> Figures:
    """Network of the statics: the thesis' of the arm (sec. 6.3), of other robots one of places."""
    if robot == ARM:
        return _train_thesis_network(seed, path, show)
    from softrobot_env.training.quasi_static import train

    trained = train(robot, seed, show)
    trained.network.save(path, trained.about)
    off = trained.errors
    return [
        ("median error of the tip at rest, unseen places", f"{1e3 * float(median(off)):.3f} mm"),
        ("largest", f"{1e3 * max(off):.3f} mm"),
        ("parameters", str(len(trained.network.parameters))),
    ]


def _train_thesis_network(seed: int, path: Path, show: Show) -> Figures:
    """Network of the quasi-static controller for the arm (thesis sec. 6.3)."""
    import numpy as np

    from softrobot_env.beams.closed_forms.constant_curvature import ConstantCurvatureStatics
    from softrobot_env.learned import bayesian, quasi_static
    from softrobot_env.learned.network import describe

    statics = ConstantCurvatureStatics(ARM)
    # Independent streams, so that the validation data are not those of another seed.
    drawn, start, fresh = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3))
    how = quasi_static.Sampling()
    samples = quasi_static.sample(statics.tip, statics.n_inputs, how, drawn)

    def report(done: int, total: int, error: float) -> None:
        show(f"squared error {error:.4g}", done, total)

    network = samples.new_network(quasi_static.HIDDEN, start)
    fit = bayesian.train(network, samples, progress=report)
    validation = quasi_static.sample(statics.tip, statics.n_inputs, how, fresh)
    reached = quasi_static.workspace(samples.inputs[:, 2:4])
    fit.network.save(path, {**describe(ARM), "workspace": reached, "seed": seed})
    return [
        ("rms error, training data", f"{quasi_static.rms(fit.network, samples):.4f} N"),
        ("rms error, fresh data", f"{quasi_static.rms(fit.network, validation):.4f} N"),
        ("parameters", str(len(fit.network.parameters))),
        ("effective parameters", f"{fit.effective_parameters:.1f}"),
        ("alpha, beta", f"{fit.alpha:.4g}, {fit.beta:.4g}"),
        ("steps", f"{fit.iterations}{' (converged)' if fit.converged else ''}"),
    ]


def _train_gains(
    closed: str, design: str, robot: RobotParams, seed: int, path: Path, show: Show
) -> Figures:
    """Gain table of a law, by its design; nothing in it is random.

    That of the arm is of the closed form (thesis sec. 6.4), those of other robots of their chain.
    """
    from softrobot_env.control.arm.operating_points import is_arm

    if is_arm(robot):
        return _train_closed_gains(closed, path, show)
    return _train_table(design, robot, seed, path, show)


def _train_table(design: str, robot: RobotParams, seed: int, path: Path, show: Show) -> Figures:
    """Gains at operating points all over the workspace of a robot, by their design."""
    from softrobot_env.control.scheduled.law import build_table
    from softrobot_env.control.scheduled.operating_points import find_points
    from softrobot_env.control.scheduled.policies import save_table

    def report(done: int, total: int) -> None:
        show("equilibria", done, total)

    points = find_points(robot, progress=report)
    table = build_table(robot, load(design)(robot), points, lambda n, m: show("gains", n, m))
    save_table(path, table, robot, points.errors)
    off = points.errors[-1] / robot.reach
    return [
        ("operating points", f"{len(points.points)} of {points.candidates} equilibria"),
        ("error of the tip between them", f"{100 * off:.3g} % of the reach"),
        ("gains per point", str(table.rows.shape[1])),
    ]


def _train_closed_gains(design: str, path: Path, show: Show) -> Figures:
    """Gain table of a law for the arm, by its design."""
    from softrobot_env.beams.closed_forms.planar_arm import make_planar_arm
    from softrobot_env.control.arm.operating_points import build_gains, save_gains

    gains = build_gains(
        ARM,
        partial(load(design), make_planar_arm(ARM)),
        lambda done, total: show("operating points", done, total),
    )
    save_gains(path, ARM, gains)
    return [
        ("operating points", " x ".join(str(count) for count in gains.shape[:3])),
        ("gains per point", str(gains.shape[3])),
    ]


def _train_imitation(robot: RobotParams, seed: int, path: Path, show: Show) -> Figures:
    """Network that imitates the model predictive controller with preview, for the arm."""
    from softrobot_env.training.artifacts import figures, save
    from softrobot_env.training.imitation import ImitationConfig, imitate

    network = imitate(ImitationConfig(), seed, show)
    save(network, path, seed)
    return figures(network)


def _train_rig_nn(robot: RobotParams, seed: int, path: Path, show: Show, twin: int = 0) -> Figures:
    """Identified parameters of a twin, for the rig's controllers (thesis sec. 5.1)."""
    from math import degrees

    from softrobot_env.identification.parameters import identify, record

    found = identify(record(twin, seed, show=show), seed)
    rig = found.parameters
    rig.save(path, RIG, {"seed": seed})
    return [
        ("twin", str(twin)),
        ("rms error, lengths of outputs", f"{1e3 * found.errors['inverse']:.3f} mm"),
        ("rms error, outputs of lengths", f"{1e3 * found.errors['forward']:.3f} mm"),
        ("bending stiffness over nominal", f"{rig.stiffness:.3f}"),
        ("bending damping over nominal", f"{rig.damping:.3f}"),
        ("turn of the tendons", f"{degrees(rig.turn):.2f} deg"),
        ("backlash of the tendons", f"{1e3 * rig.backlash:.3f} mm"),
    ]


#: Artifact (the name of its policy and its file) -> how to make it.
TRAINERS = {
    "qs_nn": Trainer(_train_qs_nn),
    "lqi": Trainer(
        partial(
            _train_gains,
            "softrobot_env.control.arm.lqi:design",
            "softrobot_env.control.scheduled.lqi:Integral",
        )
    ),
    "lq_preview": Trainer(
        partial(
            _train_gains,
            "softrobot_env.control.arm.lq_preview:preview_design",
            "softrobot_env.control.scheduled.lq_preview:Preview",
        )
    ),
    "mpc": Trainer(
        partial(_train_table, "softrobot_env.control.scheduled.policies:WithoutPreview")
    ),
    "mpc_preview": Trainer(
        partial(_train_table, "softrobot_env.control.scheduled.mpc:Constrained")
    ),
    "rig_nn": Trainer(_train_rig_nn, robot=RIG),
    "imitation": Trainer(_train_imitation, ("torch", "daqp"), ARM),
}

#: The artifact that is of one twin.
_OF_A_TWIN = "rig_nn"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        "what", nargs="?", choices=list(TRAINERS), help="an artifact; or give --algo"
    )
    parser.add_argument("--seed", type=seed, default=0, help="of the randomness; default: 0")
    parser.add_argument(
        "--twin",
        type=seed,
        metavar="SEED",
        help=f"of the twin that {_OF_A_TWIN} is of; default: 0. Others than 0 go to a file with "
        "the seed in its name, for `softrobot evaluate --learnt`",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="default: beside the robot's file, else the folder of models: where policies look",
    )
    add_robot(parser, "a name or a file; default: the thesis' of the artifact")
    train_rl.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: Neither an artifact nor an algorithm is given, or both, or an argument that is
            not theirs.
        ImportError: A package is missing; says what to install.
    """
    if (args.what is None) == (args.algo is None):
        raise ValueError(
            f"give an artifact ({', '.join(TRAINERS)}) or an algorithm (--algo "
            f"{', '.join(train_rl.ALGORITHMS)})"
        )
    foreign = train_rl.given(args) if args.what is not None else []
    if foreign:
        raise ValueError(f"{', '.join(foreign)}: only with --algo")
    if args.twin is not None and args.what != _OF_A_TWIN:
        raise ValueError(f"--twin: only with {_OF_A_TWIN}")
    robot = _robot_of(args)
    if args.out is None:
        args.out = models_dir() if robot.file is None else robot.file.parent
    console = Console()
    _check_packages(args)
    args.out.mkdir(parents=True, exist_ok=True)
    name, path, train = _job(args, robot)
    began = perf_counter()
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task(name, total=None)

        def show(description: str, done: int, total: int) -> None:
            progress.update(bar, description=f"{name}: {description}", completed=done, total=total)

        figures = train(show)
    figures = dict(figures) | {"time": f"{perf_counter() - began:.1f} s"}
    console.print(named_values(f"{name}, seed {args.seed}", figures))
    console.print(f"Wrote {path}")
    return 0


def _robot_of(args: argparse.Namespace) -> RobotParams:
    """The robot to train for; ValueError for one that the artifact is not of."""
    only = ARM if args.algo is not None else TRAINERS[args.what].robot
    if args.robot is None:
        return only or ARM
    robot = find_robot(args.robot)
    if only is not None and robot != only:
        raise ValueError(
            f"{args.algo or args.what} is trained for the robot {only.name!r} alone, not for "
            f"{robot.name!r}: train on gymnasium.make('SoftRobot/Track-v0', robot=...) with a "
            "learning library"
        )
    return robot


def _check_packages(args: argparse.Namespace) -> None:
    """Say what is missing before any work is done."""
    needed = train_rl.PACKAGES if args.algo is not None else TRAINERS[args.what].packages
    missing = [name for name in needed if find_spec(name) is None]
    if missing:
        raise ImportError(
            f"{args.algo or args.what} needs {', '.join(missing)}: "
            'pip install "softrobot_env[rl,mpc]"'
        )


def _job(
    args: argparse.Namespace, robot: RobotParams
) -> tuple[str, Path, Callable[[Show], Figures]]:
    """Name, file and training."""
    if args.algo is not None:
        name = train_rl.name_of(args)
        path = args.out / f"{name}.npz"
        return name, path, lambda show: train_rl.run(args, path, show)
    trainer, name, own = TRAINERS[args.what], args.what, {}
    shipped = robot in (ARM, RIG)
    path = args.out / (f"{name}.npz" if shipped else artifact_name(robot, name))
    if args.twin:
        name, own = f"{args.what} of twin {args.twin}", {"twin": args.twin}
        path = path.with_stem(f"{path.stem}_{args.twin}")
    return name, path, lambda show: trainer.run(robot, args.seed, path, show, **own)
