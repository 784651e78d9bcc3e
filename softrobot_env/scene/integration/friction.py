"""Dry friction of tendons in an Euler step: what sticks, what slides, by which impulses; compiled.

Elements, whole tendons or zones of them (`capstan`), obey Coulomb's law on the rate of the length
that slides, at the end of the step: either it stays, by an impulse within bounds, or it changes and
the impulse is at its bound. That of a zone grows with the tension before it, hence with what the
zones before take of it, and with how the spring of a drive gives. For a guess of what sticks and
what slides, impulses follow from a linear system whose unknowns are the impulses that stick and the
tensions of such drives; the guess is mended until it agrees with what follows.
"""

from typing import NamedTuple

from numpy import ndarray

from softrobot_env.compile.native import jit, making

from . import articulated
from . import mujoco_functions as mj
from .linear_algebra import dot, solve, substitute
from .mujoco_functions import assign

#: Guesses, before elements are balanced one by one; sweeps of that, or until all move by less than
#: a share of the largest impulse [1].
_GUESSES, _SWEEPS, _STILL = 12, 300, 1e-6

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
        owner: (unknowns,), the elements that stick, or -1 less the drive of an unknown tension.
        answers: (1 + unknowns, nv), change of velocities by known impulses and by the unknowns.
        matrix, right, unknowns: Of the linear system.
        impulses, tensions: (elements,) [N s, N], found, and the tensions before the elements.
        result: (nv,), change of velocities.
    """

    known: ndarray
    shares: ndarray
    owner: ndarray
    answers: ndarray
    matrix: ndarray
    right: ndarray
    unknowns: ndarray
    impulses: ndarray
    tensions: ndarray
    result: ndarray


@jit
def trial_size(elements, springs, nv):
    """Number of doubles that `trial_on` cuts."""
    most = elements + springs
    return elements * (3 + most) + most * (3 + most) + nv


@making
def trial_on(elements, springs, nv, answers, room):
    """Arrays for `rub`, cut from free memory but for the answers."""
    most = elements + springs
    return Trial(
        mj.cut(room, 1, elements)[0],
        mj.cut(room, elements, most),
        mj.cut(room, 1, most)[0],
        answers,
        mj.cut(room, most, most),
        mj.cut(room, 1, most)[0],
        mj.cut(room, 1, most)[0],
        mj.cut(room, 1, elements)[0],
        mj.cut(room, 1, elements)[0],
        mj.cut(room, 1, nv)[0],
    )


@jit
def guess(forces, h, trial, slides, rows):
    """Guess that all sticks and slides as it last did; fill rows to be solved for, see `rub`.

    Returns:
        Number of unknowns, one less than that of rows.
    """
    assign(forces.slide, slides)
    count = _share_out(forces, h, trial)
    _fill(forces, count, trial, rows)
    return count


@jit
def rub(v, forces, h, system, change, count):
    """Let the elements of friction act on the change (nv,) of the velocities v in a step [s].

    For as many unknowns, the first of the trial's answers are for the rows of `guess`, if that was
    called: -1 if not.
    """
    trial = system.trial
    if count < 0:
        assign(forces.slide, system.held[0])
        count = _answer(forces, h, system)
    else:
        _give_way(forces, system, count)
    for number in range(_GUESSES):
        if number:
            count = _answer(forces, h, system)
        _fill_system(v, forces, h, system, change, count)
        solve(trial.matrix, trial.unknowns, count)
        _add_up(change, count, trial)
        if _mend(v, forces, h, count, trial) == 0:
            break
    else:
        _balance(v, forces, h, system, change)
    for k in range(int(forces.counts[1])):
        forces.grip[int(forces.name[k])] = trial.impulses[k] / h
    assign(change, trial.result)
    assign(system.held[0], forces.slide)


@jit
def _answer(forces, h, system):
    """Solve for the guess; the number of unknowns."""
    count = _share_out(forces, h, system.trial)
    _fill(forces, count, system.trial, system.trial.answers)
    articulated.solve(system.tree, system.trial.answers, 1 + count)
    _give_way(forces, system, count)
    return count


@jit
def _add_up(change, count, trial):
    """The change of velocities with known impulses and the unknowns."""
    assign(trial.result, change)
    for u in range(1 + count):
        impulse = trial.unknowns[u - 1] if u else 1.0
        for i in range(change.size):
            trial.result[i] -= impulse * trial.answers[u, i]


@jit
def _balance(v, forces, h, system, change):
    """Find impulses that no guess led to: projected Gauss-Seidel sweeps from what was found last.

    Each is within its bounds whatever is left of the rest.
    """
    trial, elements = system.trial, int(forces.counts[1])
    for k in range(elements):
        forces.slide[int(forces.name[k])] = 0.0
    count = _answer(forces, h, system)
    _fill_system(v, forces, h, system, change, count)
    assign(trial.right, trial.unknowns)
    for u in range(count):
        if trial.owner[u] >= 0:
            trial.unknowns[u] = trial.impulses[int(trial.owner[u])]
    for _ in range(_SWEEPS):
        if _sweep(forces, h, count, trial) < _STILL:
            break
    _add_up(change, count, trial)


@jit
def _sweep(forces, h, count, trial):
    """Balance every unknown in turn, within its bounds; the largest change, a share of the most."""
    moved, largest, drive, tension = 0.0, 1e-300, -1.0, 0.0
    for u in range(count):
        owner, balanced = trial.owner[u], trial.right[u]
        for j in range(count):
            if j != u:
                balanced -= trial.matrix[u, j] * trial.unknowns[j]
        if not trial.matrix[u, u] > 0:
            continue
        balanced /= trial.matrix[u, u]
        if owner < 0:
            drive, tension, trial.unknowns[u] = -1 - owner, balanced, balanced
            continue
        k = int(owner)
        if forces.drive[k] != drive:
            drive, tension = forces.drive[k], _tension(forces, k)
        low, high = _bounds(forces, h, k, tension)
        side = 1.0 * (balanced > high) - 1.0 * (balanced < low)
        balanced = min(max(balanced, low), high)
        moved = max(moved, abs(balanced - trial.unknowns[u]))
        largest = max(largest, abs(balanced))
        forces.slide[int(forces.name[k])] = side
        trial.unknowns[u], trial.impulses[k] = balanced, balanced
        tension += balanced / h
    return moved / largest


@jit
def _bounds(forces, h, k, tension):
    """Least and largest impulse of an element behind a tension [N]."""
    tension = max(tension, 0.0)
    low = h * (forces.shrinks[k] * tension - forces.friction[k])
    return low, h * (forces.grows[k] * tension + forces.friction[k])


@jit
def _share_out(forces, h, trial):
    """Impulses by what is known and by the unknowns; how many those are."""
    count, first = 0, 0
    for k in range(int(forces.counts[1])):
        trial.known[k] = 0.0
        if forces.drive[k] < 0 or k == 0 or forces.drive[k - 1] != forces.drive[k]:
            first, drive = k, -1
            if _spring(forces, forces.drive[k]) >= 0:
                drive = _add_unknown(trial, count, -1 - forces.drive[k], forces.counts[1])
                count += 1
        side = forces.slide[int(forces.name[k])]
        if side == 0:
            trial.shares[k, _add_unknown(trial, count, k, forces.counts[1])] = 1.0
            count += 1
            continue
        trial.known[k] = h * side * forces.friction[k]
        share = forces.grows[k] if side > 0 else forces.shrinks[k]
        if share == 0 or not _tension(forces, k) > 0:
            continue
        if drive < 0:
            trial.known[k] += h * share * _tension(forces, k)
        else:
            trial.shares[k, drive] = h * share
        for j in range(first, k):
            trial.known[k] += share * trial.known[j]
            for u in range(count):
                trial.shares[k, u] += share * trial.shares[j, u]
    return count


@jit
def _add_unknown(trial, u, owner, elements):
    """Let the unknown u be new, which is returned."""
    trial.owner[u] = owner
    for k in range(int(elements)):
        trial.shares[k, u] = 0.0
    return u


@jit
def _spring(forces, drive):
    """Which of the springs is that of a drive, or -1."""
    for s in range(int(forces.counts[0])):
        if forces.drives[s] == drive:
            return s
    return -1


@jit
def _fill(forces, count, trial, rows):
    """Let rows be the known impulses, and those for one of each unknown."""
    for u in range(1 + count):
        row = rows[u]
        for i in range(row.size):
            row[i] = 0.0
        for k in range(int(forces.counts[1])):
            share = trial.shares[k, u - 1] if u else trial.known[k]
            if share != 0:
                arm = forces.arms[k]
                for i in range(row.size):
                    row[i] += share * arm[i]


@jit
def _give_way(forces, system, count):
    """Let springs of drives act on the answers."""
    springs = int(forces.counts[0])
    for u in range(1 + count if springs else 0):
        answer = system.trial.answers[u]
        for s in range(springs):
            system.impulses[s] = dot(forces.pulls[s], answer)
        pull(system, springs, answer)


@jit
def pull(system, springs, change):
    """Let springs of drives act on a change (nv,), by the rates of their tendons in `impulses`."""
    substitute(system.couplings, system.impulses, springs)
    for s in range(springs):
        for i in range(change.size):
            change[i] -= system.impulses[s] * system.answers[1 + s, i]


@jit
def _fill_system(v, forces, h, system, change, count):
    """The linear system for the tensions of drives and the impulses that stick."""
    trial = system.trial
    for u in range(count):
        owner = trial.owner[u]
        if owner >= 0:
            arm, scale, trial.unknowns[u] = forces.arms[int(owner)], 1.0, 0.0
        else:
            s = _spring(forces, -1 - owner)
            arm, scale = forces.pulls[s], -h * system.yields[s]
            trial.unknowns[u] = forces.tension[int(-1 - owner)] - scale * system.behind[s]
        rate = dot(arm, v) + dot(arm, change) - dot(arm, trial.answers[0])
        trial.unknowns[u] += scale * rate
        for j in range(count):
            trial.matrix[u, j] = scale * dot(arm, trial.answers[1 + j])
        if owner >= 0:
            trial.matrix[u, u] *= 1 + _GIVE
        else:
            trial.matrix[u, u] += 1.0


@jit
def _tension(forces, k):
    """Tension [N] before the zones of a drive where the step begins; 0 of whole tendons."""
    return forces.tension[int(forces.drive[k])] if forces.drive[k] >= 0 else 0.0


@jit
def _find_impulses(v, forces, h, count, trial):
    """Impulses and tensions from the unknowns; the largest impulse, and the largest rate."""
    largest, fastest, tension, drive = 0.0, 0.0, 0.0, -1.0
    for k in range(int(forces.counts[1])):
        impulse, own = trial.known[k], forces.drive[k]
        for u in range(count):
            if trial.shares[k, u] != 0:
                impulse += trial.shares[k, u] * trial.unknowns[u]
        if own != drive:
            tension, drive = _tension(forces, k), own
            for u in range(count):
                if trial.owner[u] == -1 - own:
                    tension = trial.unknowns[u]
        trial.impulses[k], trial.tensions[k] = impulse, tension
        tension += impulse / h
        largest = max(largest, abs(impulse))
        fastest = max(fastest, abs(_rate(v, forces, k, trial.result)))
    return largest, fastest


@jit
def _rate(v, forces, k, change):
    """Rate [m/s] of the length that slides in an element, after a change of the velocities."""
    return dot(forces.arms[k], v) + dot(forces.arms[k], change)


@jit
def _mend(v, forces, h, count, trial):
    """Mend the guess where it was wrong; of how many elements."""
    largest, fastest = _find_impulses(v, forces, h, count, trial)
    wrong = 0
    for k in range(int(forces.counts[1])):
        name = int(forces.name[k])
        side = forces.slide[name]
        if side == 0:
            low, high = _bounds(forces, h, k, trial.tensions[k])
            if trial.impulses[k] > high + _WEAK * largest:
                side = 1.0
            elif trial.impulses[k] < low - _WEAK * largest:
                side = -1.0
        elif side * _rate(v, forces, k, trial.result) < -_SLOW * fastest:
            side = 0.0
        if side != forces.slide[name]:
            forces.slide[name] = side
            wrong += 1
    return wrong
