"""The stages from a recording to a robot, and doubts about the result."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from time import perf_counter

import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import ProgressCallback, quiet
from softrobot_env.core.processes import chosen_processes, one_blas_thread
from softrobot_env.recordings import Header, Recording
from softrobot_env.robots import RobotParams

from ..errors import centred, size
from ..networks import Networks, networks_of
from ..visits import VISIT, visiting, visits_of
from . import assignment, least_squares, unknowns
from .assignment import Assignment
from .dynamics import Dynamics, dynamics_of
from .experiment import Experiment, best_experiments
from .least_squares import Fit, fitted, search
from .model import StaticModel
from .prediction import Prediction, predicted
from .residual import Residual, rows_of, trained
from .static_windows import at_rest
from .unknowns import HOLDS, RUBS, STAGES, Fact, Turned, Unknowns
from .validation import Validation, blocks_of, cross_validated

_PHYSICS = ("frame", "tendons", "geometry", "statics")
_TRIED = {HOLDS: "friction of the backbone", RUBS: "friction by tension"}
_FITS = 25  # steps shown as all
_LEAST_KEPT = 0.02  # rad, of a bend that friction of a backbone keeps
_ALIKE = 1.1  # times the error of an assignment, up to which another one is as good
_POOR = 0.3  # of the markers' motion, of which errors say that the robot explains little
_SMALL = 0.03  # of it, below which nothing is doubted
_BETTER = 0.8  # of the error, that another frame has to leave at most
_TURNED = 15.0  # degrees, of a frame that is another one
_UNLIKELY = 3.0  # standard deviations of the prior, beyond which a change is reported
_FAR = 1.3  # times the robot's reach, beyond which no marker can usually be
_CLOSE = 1e-3  # relative decrease of the cost at which a search by finer pieces ends
_COARSE = 0.1  # of the error, by which pieces half as long may move the markers at most
_STARTS = (-0.7, 0.7)  # further ones, of the logarithm of the stiffness


@dataclass(frozen=True)
class Identification:
    """Result of an identification.

    Attributes:
        robot: The identified robot.
        header: Of the recording, with identified values.
        believed: The robot of the file.
        recording: At rest, with known tendons, in its given frame.
        stages: The stages run.
        unknowns: The parameters.
        fit: Of the statics.
        assignment: Of columns to tendons; None if it was known.
        validation: Cross-validation, or None.
        prediction: Intervals for unseen recordings, from the validation; or None.
        residual: The learned correction; None if not requested or not helpful.
        dynamics: None for a recording at rest.
        experiments: Informative experiments, best first.
        networks: Of its statics; None without visits.
        doubts: Reasons why the result may be wrong, one per line.
        times: [s], duration of each part.
    """

    robot: RobotParams
    header: Header
    believed: RobotParams
    recording: Recording
    stages: tuple[str, ...]
    unknowns: Unknowns
    fit: Fit
    assignment: Assignment | None
    validation: Validation | None
    prediction: Prediction | None
    residual: Residual | None
    dynamics: Dynamics | None
    experiments: tuple[Experiment, ...]
    networks: Networks | None = None
    doubts: tuple[str, ...] = ()
    times: dict[str, float] = field(default_factory=dict)

    @property
    def combinations(self) -> list[least_squares.Combination]:
        """Parameter combinations that the data do not determine, least known first."""
        return least_squares.combinations(self.fit, self.unknowns.labels)


def check_stages(stages: Sequence[str]) -> tuple[str, ...]:
    """The stages in their order.

    Raises:
        ValueError: A stage is unknown, or none of them belongs to the statics.
    """
    unknown = [name for name in stages if name not in STAGES]
    if unknown or not set(stages) & set(_PHYSICS):
        raise ValueError(
            f"stages must be out of {', '.join(STAGES)}, one of the first four at least, got "
            f"{','.join(stages) or 'none'}"
        )
    return tuple(name for name in STAGES if name in stages)


@one_blas_thread()
def identify(
    recording: Recording,
    robot: RobotParams,
    stages: Sequence[str] = tuple(STAGES),
    *,
    known: Sequence[str] = (),
    any_turn: bool = False,
    validate: bool = True,
    seed: int = 0,
    show: ProgressCallback = quiet,
) -> Identification:
    """Identify a robot's parameters.

    Args:
        recording: Of the robot; if it moves, the statics use the parts at rest. Visits of a rig are
            preceded by dither.
        robot: The robot of the file.
        stages: From `STAGES`; parameters of the others stay as in the file.
        known: Kinds of parameters that are exact in the file, such as "mass".
        any_turn: Whether the recording's frame may have any position and orientation. If the
            tendons of columns are unknown, any rotation about the robot's axis is allowed anyway.
        validate: Whether to cross-validate.
        seed: Of the networks.
        show: Called with the progress.

    Raises:
        ValueError: Recording and robot do not match, or contain something that cannot be
            identified.
    """
    run = _Run(recording, robot, check_stages(stages), tuple(known), any_turn, validate, seed, show)
    for name, stage in _STEPS.items():
        began = perf_counter()
        if stage(run):
            run.times[name] = perf_counter() - began
    return run.result()


@dataclass
class _Run:
    """An identification in steps, each of which returns whether there was anything to do."""

    recording: Recording
    robot: RobotParams
    stages: tuple[str, ...]
    known: tuple[str, ...]
    any_turn: bool
    validate: bool
    seed: int
    show: ProgressCallback
    assignment: Assignment | None = None
    networks: Networks | None = None
    dynamics: Dynamics | None = None
    validation: Validation | None = None
    prediction: Prediction | None = None
    residual: Residual | None = None
    times: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        recording = self.recording
        self.visits = (recording.patterns == VISIT) & (visiting(self.robot) is not None)
        self.static = at_rest(recording, self.visits)
        self.moving = None if recording.static else recording
        if self.moving is not None and not self.visits.all():
            self.moving = self.moving.part(~self.visits)
        if not self.any_turn:
            _check_place(self.static, self.robot)

    def assign(self) -> bool:
        """Assign columns to tendons, or signs to columns."""
        robot, static, any_way = self.robot, self.static, self.any_turn
        if static.kind == "action" or "tendons" not in self.stages:
            return False
        names = set(robot.tendon_names)
        if static.tendons is None and not set(static.header.commands.columns) <= names:
            found = self.assignment = assignment.assigned(
                static,
                robot,
                lambda n: self.show("which column pulls what", n, 200),
                any_way=any_way,
            )
            self._change(partial(assignment.with_tendons, found=found))
            return True
        if static.kind == "length":
            signs = assignment.sided(static, robot, any_way=any_way)
            if min(signs) < 0:
                self._change(partial(assignment.with_signs, signs=signs))
        return False

    def _change(self, change: Callable[[Recording], Recording]) -> None:
        self.static = change(self.static)
        self.moving = None if self.moving is None else change(self.moving)

    def train(self) -> bool:
        """Train networks on the visits."""
        if "network" not in self.stages or not self.visits.any():
            return False
        self.show("networks", 0, 1)
        self.networks = networks_of(visits_of(self.static, self.robot), self.seed)
        return True

    def fit_statics(self) -> bool:
        """Fit the rows at rest.

        Few backbones have friction, and not all tendons have friction that grows with tension.
        Unless the file has one of them, the robot is fitted with neither and with each, and the
        best supported is kept; friction of the backbone only if it holds a larger bend than other
        model errors might. (No scene has both.)
        """
        self.turned: Turned = "as said" if self.assignment is None else "about the axis"
        if self.any_turn:
            self.turned = "any way"
        filed = [n for n in unknowns.FRICTIONS if n in self.known or "statics" not in self.stages]
        has = {HOLDS: self.robot.holds, RUBS: self.robot.of_tendons(RUBS).any()}
        without = [name for name in has if not has[name] and name not in filed]
        self.model, self.fit = self._tried("fit", [*filed, *without])
        plain = self.fit
        for name in () if any(has.values()) else without:
            others = [other for other in without if other != name]
            begin = plain if name == RUBS else None  # it changes the lag of rows, not the robot
            model, fit = self._tried(_TRIED[name], [*filed, *others], begin)
            keeps = name != HOLDS or _kept(model.robot_of(fit.x)) > _LEAST_KEPT
            if keeps and least_squares.pays(self.fit, fit):
                self.model, self.fit = model, fit
        self.coarse, fit = self.model, self.fit
        finer = self.model.finer()
        moved = finer.simulate(fit.x).markers - fit.simulated.markers
        if size(moved) > _COARSE * size(fit.simulated.error):
            # Parameters absorb the error of long pieces, and the chain would be wrong by it.
            self.model = finer
            self.fit = search(finer, fit.x, fit.free, fit.weights, least=_CLOSE)
        self.unknowns = self.model.unknowns
        return True

    def _tried(
        self, what: str, filed: Sequence[str], begin: Fit | None = None
    ) -> tuple[StaticModel, Fit]:
        """Model and fit of the rows at rest, with some kinds of friction as in the file.

        Starts from another fit if given.
        """
        model = StaticModel(self.robot, self.static, self.turned, known=filed)
        free, x = _free(model, self.stages, self.known), np.zeros(len(model.unknowns.spread))
        for name in _TRIED:
            free[model.unknowns.place(name)] &= name not in filed
        if self.turned == "any way":
            seen = model.simulate(x, has_friction=False).markers
            _, vector, shift = assignment.aligned(seen, model.points, any_way=True)
            model.place_frame(x, vector, shift)
        elif self.assignment is not None and self.assignment.turn:
            x[model.unknowns.place("frame_turn").stop - 1] = self.assignment.turn
        show = partial(_shown, self.show, what)
        if begin is not None:
            rough = search(model, begin.x, free, begin.weights, least=_CLOSE, show=show)
            if not least_squares.pays(begin, rough):
                return model, rough
            return model, fitted(model, rough.x, free, begin.weights, show)
        return model, _fitted(model, x, free, show)

    def fit_dynamics(self) -> bool:
        """Fit damping, delay and friction."""
        if self.moving is None or "dynamics" not in self.stages:
            return False
        header = partial(_header, self.model, recording=self.recording)
        self.dynamics, self.model, self.fit = _in_motion(
            self.model, self.fit, self.moving, header, lambda n, _: self.show("dynamics", n, 6)
        )
        return True

    def cross_validate(self) -> bool:
        """Errors of rows that were not fitted."""
        if not self.validate:
            return False
        residual, show = "residual" in self.stages, partial(self.show, "cross-validation")
        found = self.validation = cross_validated(self.coarse, self.fit, residual, show)
        robot, header = _named(self.model, self.fit), _header(self.model, self.fit, self.recording)
        static = placed(self.static, header)
        by_length = static.drive(robot) == "length"
        controls = static.controls(robot)
        self.prediction = predicted(controls, by_length, found.error, found.blocks)
        return True

    def learn_residual(self) -> bool:
        """Learn the residual of the physics."""
        if "residual" not in self.stages:
            return False
        self.show("residual", 0, 1)
        found = self.fit.simulated
        self.residual = trained(*rows_of(self.model, found), found.error, blocks_of(self.static))
        return True

    def widen(self) -> bool:
        """Widen the parameters' intervals by the disagreement of blocks."""
        self.fit = least_squares.with_blocks(self.fit, blocks_of(self.static))
        return True

    def ask(self) -> bool:
        """Find informative experiments."""
        self.show("what would tell more", 0, 1)
        self.experiments = tuple(best_experiments(self.model, self.fit))
        return True

    def doubt(self) -> bool:
        """Why the result may be wrong."""
        self.doubts = (*_unsure(self.assignment), *_doubts(self.model, self.fit, self.recording))
        return True

    def result(self) -> Identification:
        """The complete result."""
        header = _header(self.model, self.fit, self.recording)
        robot = _named(self.model, self.fit)
        if self.dynamics is not None:
            robot, header = self.dynamics.robot, header.later(self.dynamics.delay)
        own = robot, header, self.robot, self.static
        rest = [getattr(self, one.name) for one in fields(Identification)[len(own) :]]
        return Identification(*own, *rest)


#: Steps of an identification, in this order.
_STEPS: dict[str, Callable[[_Run], bool]] = {
    "assignment": _Run.assign,
    "networks": _Run.train,
    "fit": _Run.fit_statics,
    "dynamics": _Run.fit_dynamics,
    "cross-validation": _Run.cross_validate,
    "residual": _Run.learn_residual,
    "intervals": _Run.widen,
    "experiments": _Run.ask,
    "doubts": _Run.doubt,
}


def _shown(show: ProgressCallback, what: str, step: int, _: float) -> None:
    show(what, min(step, _FITS), _FITS)


def _unsure(found: Assignment | None) -> tuple[str, ...]:
    """Whether another assignment of columns fits almost as well."""
    if found is None or found.second > _ALIKE * found.rms:
        return ()
    return (
        "which column pulls which tendon is not sure: another assignment leaves "
        f"{1e3 * found.second:.1f} mm, this one {1e3 * found.rms:.1f} mm, and more may have been "
        "missed; say it by commands.tendons if you can",
    )


def _doubts(model: StaticModel, fit: Fit, recording: Recording) -> Iterator[str]:
    """Reasons why the result may be wrong, one per line."""
    static, error = model.recording, fit.simulated.error
    left, moved = size(error), size(centred(model.points))
    if left > _POOR * moved:
        yield (
            f"errors of {1e3 * left:.3g} mm are {left / moved:.0%} of what the markers move: the "
            "robot found explains little of the recording"
        )
    lost = int(np.sum(~fit.simulated.found))
    if lost:
        yield f"{lost} of {len(error)} rows have no equilibrium that was found"
    given, signed = recording.header.commands.factors, static.header.commands.factors
    for k, column in enumerate(static.header.commands.columns):
        if given is None and signed is not None and signed[k] < 0:
            yield f"column {column} counts what is let out (found; the header says no factors)"
    if static.kind != "action" and left > _SMALL * moved:
        placed_here = placed(static, model.header_of(fit.x, static.header))
        other = assignment.doubted(placed_here, model.robot_of(fit.x))
        if other is not None:
            yield other
    if left > _SMALL * moved:
        rms, vector, _ = assignment.aligned(
            fit.simulated.markers, fit.simulated.markers - error, any_way=True
        )
        turn = np.degrees(np.linalg.norm(vector))
        if rms < _BETTER * left and turn > _TURNED:
            yield (
                f"turned by {turn:.0f} degrees the recording would leave {rms / left:.0%} of the "
                "error: look at the header's frame, or let --any-turn find it"
            )
    free, spread = fit.free, model.unknowns.spread
    for label, change, own, is_free in zip(model.unknowns.labels, fit.x, spread, free, strict=True):
        if is_free and abs(change) > _UNLIKELY * own and not label.startswith("frame_"):
            yield f"{label} is {abs(change) / own:.1f} times as far from the file as is usual"


def _named(model: StaticModel, fit: Fit) -> RobotParams:
    """The robot of a fit."""
    return replace(model.robot_of(fit.x), name=f"{model.robot.name}_identified")


def _header(model: StaticModel, fit: Fit, recording: Recording) -> Header:
    """The header of a fit, for the recording as it was read."""
    header = model.header_of(fit.x, model.recording.header)
    return replace(_losing(header, recording.header), static=recording.static)


def _losing(header: Header, *others: Header) -> Header:
    """The header, with markers that may be lost where those of one of others may."""
    pairs = zip(header.marker, *(other.marker for other in others), strict=True)
    markers = (replace(m, may_be_lost=any(x.may_be_lost for x in rest)) for m, *rest in pairs)
    return replace(header, marker=tuple(markers))


def _in_motion(
    model: StaticModel,
    fit: Fit,
    moving: Recording,
    header: Callable[[Fit], Header],
    show: Callable[[int, float], None],
) -> tuple[Dynamics, StaticModel, Fit]:
    """The dynamics, and the statics' model and fit with what the motion shows of them.

    At rest, friction of tendons and backlash of servos have the same effect: tendons lag behind
    their commands. The oscillation under a constant command depends on friction alone, and its
    frequency gives the ratio of stiffness to mass. If no servo can have backlash, the friction in
    motion is used. Its difference from that at rest shows errors of the friction law, such as
    tendons that yield a little before they slide: half of it counts as a standard deviation, also
    of damping and delay as far as they depend on friction.
    """
    known, x = model.unknowns, fit.x.copy()
    rubbing, backlash = (known.place(name) for name in unknowns.LAGS)
    stiff = known.place("youngs_modulus")
    first = dynamics_of(
        _named(model, fit),
        placed(moving, header(fit)),
        _common(known, fit, "youngs_modulus"),
        _common(known, fit, "tendon_friction") if fit.free[rubbing].any() else None,
        show=show,
    )
    if backlash is None or not (fit.free[rubbing].all() and fit.free[backlash].all()):
        other, own = first.friction
        friction = (other, float(np.hypot(own, other / 2)))
        deviation = np.hypot(first.deviation, first.by_friction * other / 2)
        return replace(first, friction=friction, deviation=deviation), model, fit
    x[rubbing] += first.friction[0]
    common = known.common("tendon_friction")
    facts = [Fact(common, float(common @ x), first.friction[1])]
    if fit.free[stiff].all():
        ratio = known.common("youngs_modulus") - known.common("mass")
        x[stiff] += first.modulus[0]
        facts.append(Fact(ratio, float(ratio @ x), first.modulus[1]))
    model = model.with_facts(*facts)
    again = fitted(model, x, fit.free, fit.weights)
    second = dynamics_of(
        _named(model, again),
        placed(moving, header(again)),
        friction=None,
        begin=first.values,
        show=show,
    )
    return replace(second, deviation=first.deviation, before=first.before), model, again


def placed(recording: Recording, header: Header) -> Recording:
    """The recording as it is read with another header of the same columns."""
    old = recording.header
    new = _losing(header, header, old)  # what was lost stays so
    raw = (recording.commands - old.commands.offset) / old.commands.scale
    return replace(
        recording,
        header=new,
        markers=new.frame.to_world(old.frame.to_recorded(recording.markers)),
        commands=raw * new.commands.scale + new.commands.offset,
    )


def _common(known: Unknowns, fit: Fit, name: str) -> float:
    """Standard deviation of the common part of the parameters of a kind."""
    place = known.place(name)
    return float(np.sqrt(fit.covariance[place, place].mean()))


def _check_place(recording: Recording, robot: RobotParams) -> None:
    """Raise ValueError if a marker is mostly out of the robot's reach."""
    for k, places in enumerate(recording.markers.swapaxes(0, 1), 1):
        away = np.sqrt(np.nansum((places - robot.clamp.position) ** 2, axis=1))
        far = float(np.median(away[~np.isnan(places).all(axis=1)])) if places.size else 0.0
        if far > _FAR * robot.reach:
            raise ValueError(
                f"marker {k} is usually {1e3 * far:.4g} mm from the clamp, the robot reaches "
                f"{1e3 * robot.reach:.4g} mm: look at the header's units and frame, or let "
                "--any-turn find the frame"
            )


def _free(model: StaticModel, stages: Sequence[str], known: Sequence[str]) -> ndarray:
    """(p,) bool: parameters of the stages, except rotations of incompletely measured points.

    Raises:
        ValueError: A known kind does not exist, or nothing is left to identify.
    """
    free = model.unknowns.of(stages)
    for name in known:
        place = model.unknowns.place(name)
        if place is None:
            kinds = ", ".join(group.name for group in model.unknowns.groups)
            raise ValueError(f"known must be out of {kinds}, got {name!r}")
        free[place] = False
    if np.isnan(model.points).all(axis=(0, 1)).any():
        for name in ("frame_turn", "gravity_tilt"):  # each rotates the recording's frame
            place = model.unknowns.place(name)
            free[place or slice(0)] = False
    return free


def _kept(robot: RobotParams) -> float:
    """Bend [rad] that friction of the backbone can keep, of the whole robot."""
    sections, ends = robot.backbone.sections, robot.backbone.ends
    stiffness = robot.backbone.bending((ends[:-1] + ends[1:]) / 2)
    turns = [s.bending_friction * s.length / k for s, k in zip(sections, stiffness, strict=True)]
    return float(sum(turns))


def _fitted(
    model: StaticModel, x: ndarray, free: ndarray, show: Callable[[int, float], None]
) -> Fit:
    """The frame at first, then everything; from half and twice the stiffness as well if needed.

    These two at a time if processes were chosen by `processes.using`.
    """
    start = least_squares.first_weights(model)
    frame = free & model.unknowns.of(["frame"])
    if frame.any():
        x = search(model, x, frame, start, has_friction=False, steps=4).x
    best = fitted(model, x, free, start, show)
    stiff = model.unknowns.place("youngs_modulus")
    if size(best.simulated.error) < 2.5 * start.deviation or stiff is None or not free[stiff].any():
        return best
    others = np.tile(x, (len(_STARTS), 1))
    others[:, stiff] += np.array(_STARTS)[:, None]
    with chosen_processes() as pool:
        if pool is None:
            trials = [fitted(model, other, free, start, show) for other in others]
        else:
            trials = pool.map(partial(fitted, model, free=free, start=start), others)
        return min((best, *trials), key=lambda fit: size(fit.simulated.error))
