"""Maps of stability over timestep, stiffness, damping, resolution and integrator.

The arm has no gravity, its tensions grow with its stiffness and the damping ratio is kept, so all
stiffnesses move alike in units of the first period T1: refined runs are made once and stretched.
The map is drawn over the absolute timestep and the stiffness nevertheless, as these are what a
user sets; similarity then shows as diagonals of equal colour, and where absolute times (the
control period in the timestep rule) break it, that shows too.
"""

from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import product
from math import pi

from numpy import ndarray

from softrobot_env.robots import ARM, RobotParams
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.statics import equilibrium
from softrobot_env.scene.timestep import stability_limit
from studies.accuracy.tension_step import END, START, tensions
from studies.beams import make_beam
from studies.stability import runs
from studies.stability.runs import BEAM_METHODS, CHAIN, CHAIN_INTEGRATORS, Plan, Reference, Row

#: [s]: what a user would try. Stiffness in units of the arm's.
TIMESTEPS = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)
STIFFNESSES = (1e-2, 1e-1, 1.0, 1e1, 1e2, 1e3, 1e4)

#: Damping ratio of the arm's first mode.
NOMINAL = ARM.damping_time * pi * ARM.first_frequency
ALL_DAMPINGS = (0.0, 0.01, NOMINAL, 1.0, 5.0)
SOME_DAMPINGS = (0.0, NOMINAL, 5.0)

#: First periods simulated, and samples of the tip in each.
PERIODS = 3
SAMPLES = 200

#: Steps of a run: enough to see an instability grow, few enough to bear the cost.
LEAST_STEPS, MOST_STEPS = 50, 3000
MOST_RULE_STEPS = 20_000

#: [m], 5 % of the length.
BOUND = 0.05 * ARM.length

#: Timesteps in units of the linearised chain's limit.
LIMIT_RATIOS = (0.5, 0.7, 0.85, 0.95, 1.05, 1.2, 1.5, 2.0, 3.0)

_REFERENCE_STEPS = 1000  # per first period, at least
_LIMIT_SHARE = 0.4
_LARGEST_LIMIT = 0.1


def damped(robot: RobotParams, damping_ratio: float) -> RobotParams:
    """The robot with a damping ratio of its first mode."""
    return replace(robot, damping_time=damping_ratio / (pi * robot.first_frequency))


def scaled_arm(stiffness: float, damping_ratio: float) -> RobotParams:
    """The arm with its stiffness multiplied and a damping ratio of the first mode.

    Its tension limits grow along; else they would cut the tensions of a stiff arm.
    """
    robot = damped(ARM.vary(youngs_modulus=stiffness), damping_ratio)
    tendons = (replace(t, tension_limit=stiffness * t.tension_limit) for t in ARM.tendons)
    return replace(robot, tendons=tuple(tendons))


@dataclass(frozen=True)
class Family:
    """A model with a number of hinges or pieces, in all stiffnesses and dampings.

    Attributes:
        model: `CHAIN`, or a name of `make_beam`.
        n: Number of hinges or pieces.
    """

    model: str
    n: int

    @property
    def integrators(self) -> tuple[str, ...]:
        """Names of its integrators or methods."""
        return CHAIN_INTEGRATORS if self.model == CHAIN else BEAM_METHODS

    @lru_cache(1)  # noqa: B019 (a run has few families)
    def system(self, stiffness: float, damping: float) -> runs.System:
        """The robot in the equilibrium of `START`, with the tensions of `END`."""
        robot = scaled_arm(stiffness, damping)
        inputs = tensions(robot, END)
        if self.model == CHAIN:
            return runs.ChainSystem(SceneConfig(robot, pieces=self.n // 2), self.posture(), inputs)
        return runs.BeamSystem(make_beam(self.model, robot, self.n), self.posture(), inputs)

    @cache  # noqa: B019
    def posture(self) -> ndarray:
        """The equilibrium of `START`, which all stiffnesses have."""
        robot = scaled_arm(STIFFNESSES[0], NOMINAL)
        u = tensions(robot, START)
        if self.model != CHAIN:
            return make_beam(self.model, robot, self.n).equilibrium(u, check_stability=False)
        scene = runs.neutral_scene(SceneConfig(robot, pieces=self.n // 2))
        return equilibrium(scene.model, u)

    def reference(self, stiffness: float, damping: float) -> Reference:
        """The refined motion, computed for the arm's own stiffness."""
        return self._refined(damping).stretched(stiffness**-0.5)

    @cache  # noqa: B019
    def _refined(self, damping: float) -> Reference:
        system, period = self.system(1.0, damping), 1 / ARM.first_frequency
        sample = period / SAMPLES
        if self.model != CHAIN:
            return runs.beam_reference(system, PERIODS * period, sample)
        limit = stability_limit("implicitfast", system.linear)
        most = min(period / _REFERENCE_STEPS, _LIMIT_SHARE * limit)
        return runs.chain_reference(system, PERIODS * period, sample, most)


def run_cell(
    family: Family,
    stiffness: float,
    damping: float,
    integrator: str,
    timestep: float,
    case: str = "map",
) -> Row:
    """Run one cell of a map.

    It lasts `PERIODS` first periods, but at least `LEAST_STEPS`, and at most `MOST_STEPS` or, in
    the case "rule", `MOST_RULE_STEPS`. The tip is compared while the refined run lasts.
    """
    system, robot = family.system(stiffness, damping), scaled_arm(stiffness, damping)
    reference = family.reference(stiffness, damping)
    period, most = 1 / robot.first_frequency, MOST_RULE_STEPS if case == "rule" else MOST_STEPS
    steps = runs.steps_for(PERIODS * period, timestep, LEAST_STEPS, most)
    plan = Plan(integrator, timestep, steps, min(period, steps * timestep) / 40)
    trace = system.run(plan)
    about = {"case": case, "e_bound": BOUND, "stability_limit": system.limit(integrator)}
    about |= {"damping_scale": robot.damping_time / ARM.damping_time, "damping_ratio": damping}
    about |= {"stiffness_scale": stiffness, "reference": runs.REFINED}
    about["uncertainty"] = reference.uncertainty
    verdict = runs.judge(trace, reference, BOUND)
    return Row.of(plan, trace, verdict, **vars(family), **about)


def map_rows(
    family: Family,
    damping: float,
    timesteps: tuple[float, ...] = TIMESTEPS,
    stiffnesses: tuple[float, ...] = STIFFNESSES,
    ratios: tuple[float, ...] = LIMIT_RATIOS,
) -> list[Row]:
    """All cells of one damping ratio; of a chain also the rule, and runs around its limit.

    The rule picks by itself, and for every integrator that a user may fix. The stability limit is
    that of the linearised chain in the arm's own stiffness; limits beyond `_LARGEST_LIMIT` first
    periods are left out: accuracy asks for less.
    """
    found = [
        run_cell(family, stiffness, damping, integrator, timestep)
        for stiffness, integrator, timestep in product(stiffnesses, family.integrators, timesteps)
    ]
    if family.model != CHAIN:
        return found
    for stiffness, asked in product(stiffnesses, (None, *family.integrators)):
        choice = runs.rule_choice(family.system(stiffness, damping), asked)
        picked = stiffness, damping, choice.integrator, choice.timestep
        found.append(run_cell(family, *picked, "rule_asked" if asked else "rule"))
    linear = family.system(1.0, damping).linear
    for integrator in family.integrators:
        limit = float(stability_limit(integrator, linear))
        if limit <= _LARGEST_LIMIT / ARM.first_frequency:
            steps = (ratio * limit for ratio in ratios)
            found += [run_cell(family, 1.0, damping, integrator, h, "limit") for h in steps]
    return found
