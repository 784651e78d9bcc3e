"""Whether models of equal physics converge to the same, in statics and in motion.

Shear and extension are quantified in two ways: against geometrically exact solutions with them,
and on a slender robot, whose radius is a thirtieth and whose bending stiffness and mass per length
are the same. There they are 900 times less, and all models must agree.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from softrobot_env.benchmarks.accuracy.cases import motions, spiral, tension_step
from softrobot_env.benchmarks.accuracy.cases.beam_models import CONTESTANTS, DISTRIBUTED, Contestant
from softrobot_env.benchmarks.accuracy.cases.statics import StaticCase
from softrobot_env.benchmarks.accuracy.rows import (
    BENDING,
    BOUND,
    CONTINUUM,
    Limit,
    Physics,
    Row,
    agreement_row,
    distance,
)
from softrobot_env.robots import ARM, RobotParams

_SLENDER = 30.0

#: Elements of a slender continuum, which converges slowly: bending also strains its fibres.
_FINE = 96

#: Pieces of the limits of each model in the spiral and the tension step, full and quick.
_SIZES = {
    ("pcc", spiral.CASE): ((5, 10, 20), (3, 6, 12)),
    ("pcc", tension_step.CASE): ((6, 12, 24), (3, 6, 12)),
    ("cosserat", spiral.CASE): ((8, 16, 32), (8, 16, 32)),
    ("cosserat", tension_step.CASE): ((12, 24, 48), (6, 12, 24)),
    ("ancf", spiral.CASE): ((3, 6, 12), (2, 4, 8)),
    ("ancf", tension_step.CASE): ((6, 12, 24), (3, 6, 12)),
}


#: Case -> module with its `beam_motion`, and robot.
MOTIONS = {spiral.CASE: (spiral, spiral.ROBOT), tension_step.CASE: (tension_step, ARM)}


def slender(robot: RobotParams) -> RobotParams:
    """A robot of equal EI and mass per length, with a thirtieth of the radius."""
    return replace(
        robot,
        outer_radius=robot.outer_radius / _SLENDER,
        inner_radius=robot.inner_radius / _SLENDER,
        youngs_modulus=robot.youngs_modulus * _SLENDER**4,
        density=robot.density * _SLENDER**2,
    )


def static_rows(
    case: StaticCase, tips: dict[tuple[str, Physics], dict[int, np.ndarray]]
) -> list[Row]:
    """How far the limits of models are from the exact equilibrium of their physics.

    Args:
        case: The case.
        tips: Tips (2,) [m] by model, physics and number of pieces; the two finest are extrapolated
            to infinitely many for an error of second order.
    """
    found = []
    for (model, physics), by_size in tips.items():
        coarse, fine = sorted(by_size)[-2:]
        square = (fine / coarse) ** 2
        limit = (square * by_size[fine] - by_size[coarse]) / (square - 1)
        truth, text = case.truth(physics)
        text = f"limit of n = {coarse}, {fine}; {text}"
        gap, length = distance(limit, truth), case.robot.length
        row = agreement_row(case.name, model, fine, gap, length, physics.name, text)
        # Where bending is not uniform, no rod is the limit of a continuum: reported, not checked.
        unknown = physics == CONTINUUM and not case.uniform
        found.append(_unchecked(row) if unknown else row)
    return found


def slender_static_rows(case: StaticCase) -> list[Row]:
    """How far a fine continuum model of a slender robot is from the exact rod that only bends."""
    robot, found = slender(case.robot), []
    for contestant in CONTESTANTS:
        if contestant.physics == CONTINUUM:
            model = contestant.build(robot, _FINE, case.loads)
            q = model.equilibrium(case.ctrl, load_steps=5, check_stability=False)
            truth, text = case.truth(BENDING)
            gap = distance(model.tip(q)[[0, 2]], truth)
            name, length = f"{contestant.name}, slender", robot.length
            found.append(agreement_row(case.name, name, _FINE, gap, length, BENDING.name, text))
    return found


def beam_limit(
    case: str, contestant: Contestant, quick: bool, robot: RobotParams | None = None
) -> Limit:
    """Converged motion of a model, of the case's own robot unless another is given."""
    sizes = _SIZES[contestant.name.split("/")[0], case][quick]
    module, own = MOTIONS[case]
    return motions.beam_limit(module.beam_motion, contestant, sizes, robot or own)


def dynamic_rows(case: str, limits: dict[tuple[str, str], Limit], quick: bool) -> list[Row]:
    """Distances of the limits of different models.

    Args:
        case: "spiral" or "tension_step".
        limits: Converged motion by case and physics.
        quick: Coarser limits, and no slender robot.
    """
    _, robot = MOTIONS[case]
    truth = limits[case, BENDING.name]
    turning = case == spiral.CASE
    chain = (spiral.chain_limit if turning else tension_step.converged_reference)(quick)
    name = DISTRIBUTED.name
    found = [_pair(case, f"mujoco_chain/gauss2 / {name}", chain, truth, robot)]
    for contestant in CONTESTANTS:
        if contestant.physics != BENDING:
            other = limits[case, contestant.physics.name]
            pair = f"{contestant.name} / {name} (other physics)"
            # Not a check: what shear and extension do to the motion.
            found.append(_unchecked(_pair(case, pair, other, truth, robot)))
    return found if quick else found + list(_slender_rows(case, slender(robot)))


def _slender_rows(case: str, robot: RobotParams) -> Iterator[Row]:
    truth = beam_limit(case, DISTRIBUTED, True, robot)
    for contestant in CONTESTANTS:
        if contestant.physics != BENDING:
            limit = beam_limit(case, contestant, True, robot)
            pair = f"{contestant.name} / {DISTRIBUTED.name}, slender"
            yield _pair(case, pair, limit, truth, robot)


def _pair(case: str, pair: str, a: Limit, b: Limit, robot: RobotParams) -> Row:
    error = np.linalg.norm(a.tips - b.tips, axis=-1)
    gap, text = distance(a.tips, b.tips), f"{a.text}; {b.text}"
    row = agreement_row(case, pair, None, gap, robot.length, BENDING.name, text)
    row = replace(row, e_mean=float(error.mean()))
    if max(a.uncertainty, b.uncertainty) > BOUND * robot.length:
        return replace(_unchecked(row), model=f"{pair}: no limit found")
    return row


def _unchecked(row: Row) -> Row:
    """What other physics, or an unknown limit, make of an agreement: a distance without a bound."""
    return replace(row, kind="physics", limit=None, met=None)
