"""Springs of drives and dry friction of tendons in an Euler step; compiled.

Elements of friction, whole tendons or zones of them (`capstan`), obey Coulomb's law on the rate of
the length that slides, at the end of the step: either it stays, by an impulse within bounds, or it
changes and the impulse is at its bound. That of a zone grows with the tension before it, hence with
what the zones before take of it, and with how the spring of a drive gives. For a guess of what
sticks and what slides, all follows from a linear system whose unknowns are the tensions of drives
with springs and the impulses of what sticks; the guess is mended until it agrees with what follows.

Mended all at once, guesses may go round in circles. So where that leaves no fewer of them wrong for
some rounds, only the last wrong one is mended until it does (J. J. Judice and F. M. Pires 1994):
that ends if the system has one solution.
"""

from typing import NamedTuple

from numpy import ndarray

from softrobot_env.compile.native import jit, making

from . import articulated
from . import mujoco_functions as mj
from .articulated import SIDE
from .linear_algebra import dot, solve
from .mujoco_functions import assign

#: Guesses at most, and how many may leave no fewer wrong before they are mended one by one.
_GUESSES, _PATIENCE = 200, 4

#: Share [1] by which what sticks gives: it says how elements share what they could hold alone, and
#: lets a tendon creep by 1e-9 of what it would slide.
_GIVE = 1e-9

#: Shares [1] of the largest rate and impulse that are rounding.
_SLOW, _WEAK = 1e-9, 1e-7


class Trial(NamedTuple):
    """What follows from a guess of what sticks and what slides.

    Attributes:
        known: (elements,) [N s], the part of impulses that is known.
        shares: (elements, unknowns), the rest over the unknowns.
        lead: (unknowns,), the tension before an element, over the unknowns, times the step.
        owner: (unknowns,), the elements that stick, after the springs.
        answers: (nv, 1 + unknowns), change of velocities by what is known and by the unknowns.
        moments: (1 + unknowns,), rates of a tendon by these.
        matrix, unknowns: Of the linear system.
        impulses, sides: (elements,) [N s] found, and the mended guess.
        after: (nv,), velocities at the end of the step.
        failed: (1,), whether no guess agreed, in any step since that was reset.
    """

    known: ndarray
    shares: ndarray
    lead: ndarray
    owner: ndarray
    answers: ndarray
    moments: ndarray
    matrix: ndarray
    unknowns: ndarray
    impulses: ndarray
    sides: ndarray
    after: ndarray
    failed: ndarray


@jit
def trial_size(elements, springs, nv):
    """Number of doubles that `trial_on` cuts."""
    most = elements + springs
    width = SIDE * articulated.groups(1 + most)
    return elements * (3 + most) + most * (3 + most) + width * (nv + 1) + nv + 1


@making
def trial_on(elements, springs, nv, room):
    """Arrays for `settle`, cut from free memory."""
    most = elements + springs
    width = SIDE * articulated.groups(1 + most)
    return Trial(
        mj.cut(room, 1, elements)[0],
        mj.cut(room, elements, most),
        mj.cut(room, 1, most)[0],
        mj.cut(room, 1, most)[0],
        mj.cut(room, nv, width),
        mj.cut(room, 1, width)[0],
        mj.cut(room, most, most),
        mj.cut(room, 1, most)[0],
        mj.cut(room, 1, elements)[0],
        mj.cut(room, 1, elements)[0],
        mj.cut(room, 1, nv)[0],
        mj.cut(room, 1, 1)[0],
    )


@jit
def settle(v, forces, h, system, change, again):
    """Find the change (nv,) of the velocities v in a step [s] by all forces, springs and friction.

    With `again`, as after a call in which only springs were others.
    """
    trial, elements = system.trial, int(forces.counts[1])
    if not again:
        assign(forces.slide, system.held[0])
    fewest, patience = elements + 1, _PATIENCE
    for number in range(_GUESSES):
        if number or not again or trial.failed[0]:
            _answer(forces, h, system)
        count = _count(forces)
        if count:
            _fill_system(v, forces, h, system, count)
            solve(trial.matrix, trial.unknowns, count)
        _add_up(v, change, count, trial)
        if elements == 0:
            return
        _find_impulses(forces, h, count, trial)
        wrong = _mend(forces, h, trial)
        if wrong == 0:
            break
        fewest, patience = (wrong, _PATIENCE) if wrong < fewest else (fewest, patience - 1)
        _adopt(forces, trial, patience > 0)
    else:
        trial.failed[0] = 1.0
    for k in range(elements):
        forces.grip[int(forces.name[k])] = trial.impulses[k] / h
    assign(system.held[0], forces.slide)


@jit
def _count(forces):
    """Number of unknowns."""
    count = int(forces.counts[0])
    for k in range(int(forces.counts[1])):
        count += forces.slide[int(forces.name[k])] == 0
    return count


@jit
def _answer(forces, h, system):
    """Solve for the guess."""
    count = _count(forces)
    _share_out(forces, h, system.trial, count)
    _fill(forces, h, system, count)
    articulated.solve(system.tree, system.trial.answers, 1 + count)


@jit
def _share_out(forces, h, trial, count):
    """Impulses of elements by what is known and by the unknowns."""
    stuck, ahead, spring, lead = int(forces.counts[0]), 0.0, -1, trial.lead
    for k in range(int(forces.counts[1])):
        shares, drive = trial.shares[k], int(forces.drive[k])
        if drive < 0 or k == 0 or forces.drive[k - 1] != drive:
            spring = _spring(forces, drive)
            ahead = h * forces.tension[drive] if drive >= 0 and spring < 0 else 0.0
            for u in range(count):
                lead[u] = h * (u == spring)
        side = forces.slide[int(forces.name[k])]
        share = forces.grows[k] if side > 0 else forces.shrinks[k]
        if side == 0 or drive < 0 or not forces.tension[drive] > 0:
            share = 0.0
        trial.known[k] = h * side * forces.friction[k] + share * ahead
        for u in range(count):
            shares[u] = share * lead[u]
        if side == 0:
            trial.owner[stuck], shares[stuck] = k, 1.0
            stuck += 1
        ahead += trial.known[k]
        for u in range(count):
            lead[u] += shares[u]


@jit
def _spring(forces, drive):
    """Which of the springs is that of a drive, or -1."""
    for s in range(int(forces.counts[0])):
        if forces.drives[s] == drive:
            return s
    return -1


@jit
def _fill(forces, h, system, count):
    """Let the answers be what acts: what is known, and one of each unknown."""
    trial, springs, row = system.trial, int(forces.counts[0]), system.trial.after
    for u in range(1 + count):
        if u == 0:
            assign(row, system.right)
            for s in range(springs):
                _add(row, -h * forces.tension[int(forces.drives[s])], forces.pulls[s])
        else:
            for i in range(row.size):
                row[i] = 0.0
            if u <= springs:
                _add(row, -h, forces.pulls[u - 1])
        for k in range(int(forces.counts[1])):
            share = trial.shares[k, u - 1] if u else -trial.known[k]
            if share != 0:
                _add(row, share, forces.arms[k])
        for i in range(row.size):
            trial.answers[i, u] = row[i]


@jit
def _add(row, share, other):
    """Add a share of (nv,) to a row."""
    for i in range(row.size):
        row[i] += share * other[i]


@jit
def _fill_system(v, forces, h, system, count):
    """The linear system for the tensions of drives and the impulses that stick."""
    trial, springs = system.trial, int(forces.counts[0])
    for u in range(count):
        if u < springs:  # T = T0 - h k (rate - that at which it had no impulse)
            arm, scale = forces.pulls[u], -h * system.yields[u]
            tension = forces.tension[int(forces.drives[u])]
            trial.unknowns[u] = tension - scale * system.behind[u]
        else:
            arm, scale, trial.unknowns[u] = forces.arms[int(trial.owner[u])], 1.0, 0.0
        _find_moments(trial, arm, count)
        trial.unknowns[u] += scale * (dot(arm, v) + trial.moments[0])
        for j in range(count):
            trial.matrix[u, j] = scale * trial.moments[1 + j]
        if u < springs:
            trial.matrix[u, u] += 1.0
        else:
            trial.matrix[u, u] *= 1 + _GIVE


@jit
def _find_moments(trial, arm, count):
    """Rates (1 + unknowns,) along a moment arm by all answers."""
    moments = trial.moments
    for j in range(1 + count):
        moments[j] = 0.0
    for i in range(arm.size):
        if arm[i] != 0:
            share, row = arm[i], trial.answers[i]
            for j in range(1 + count):
                moments[j] += share * row[j]


@jit
def _add_up(v, change, count, trial):
    """The change of velocities with what is known and the unknowns, and the velocities after it."""
    for i in range(v.size):
        row, total = trial.answers[i], trial.answers[i, 0]
        for u in range(count):
            total -= trial.unknowns[u] * row[1 + u]
        change[i], trial.after[i] = total, v[i] + total


@jit
def _find_impulses(forces, h, count, trial):
    """Impulses of all elements from the unknowns."""
    for k in range(int(forces.counts[1])):
        impulse, shares = trial.known[k], trial.shares[k]
        for u in range(count):
            impulse += shares[u] * trial.unknowns[u]
        trial.impulses[k] = impulse


@jit
def _mend(forces, h, trial):
    """Mend the guess where it was wrong; of how many elements."""
    largest, fastest, wrong, ahead, drive = 0.0, 0.0, 0, 0.0, -1
    elements = int(forces.counts[1])
    for k in range(elements):
        trial.sides[k] = dot(forces.arms[k], trial.after)
        fastest = max(fastest, abs(trial.sides[k]))
        largest = max(largest, abs(trial.impulses[k]))
    for k in range(elements):
        own, impulse = int(forces.drive[k]), trial.impulses[k]
        if own != drive:
            drive, spring = own, _spring(forces, own)
            ahead = trial.unknowns[spring] if spring >= 0 else _tension(forces, own)
        side, rate = forces.slide[int(forces.name[k])], trial.sides[k]
        trial.sides[k] = side
        if side == 0:
            taut, rough = max(ahead, 0.0), forces.friction[k]
            if impulse > h * (forces.grows[k] * taut + rough) + _WEAK * largest:
                trial.sides[k] = 1.0
            elif impulse < h * (forces.shrinks[k] * taut - rough) - _WEAK * largest:
                trial.sides[k] = -1.0
        elif side * rate < -_SLOW * fastest:
            trial.sides[k] = 0.0
        wrong += trial.sides[k] != side
        ahead += impulse / h
    return wrong


@jit
def _tension(forces, drive):
    """Tension [N] of a drive where the step begins; 0 of whole tendons."""
    return forces.tension[drive] if drive >= 0 else 0.0


@jit
def _adopt(forces, trial, everywhere):
    """Let the mended guess be in force, everywhere or of the last element that was wrong."""
    for k in range(int(forces.counts[1]) - 1, -1, -1):
        name = int(forces.name[k])
        if forces.slide[name] != trial.sides[k]:
            forces.slide[name] = trial.sides[k]
            if not everywhere:
                return
