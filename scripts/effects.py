"""What effects that `softrobot identify` does not have would change on a recording at rest.

An effect is a few further parameters, as small as a prior says. All are linear about what was
identified, and found together with the parameters that there are, so that a table takes minutes.
What pulls a tendon in, or lets it out, counts as a change of its command: by how much follows from
the posture that was found. Judged is on blocks that were left out of the fit, and on patterns
whose name begins with --apart, predicted from all others.

    python scripts/effects.py first.csv --header assets/recordings/ftdcr_v4.toml \\
        --robot ftdcr_v4 --apart rep1_pair --out docs/results
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy import ndarray
from numpy.linalg import inv, norm, solve
from scipy.spatial.transform import Rotation

from softrobot_env.commands.output import new_results
from softrobot_env.core.files import write_text
from softrobot_env.evaluation.report import write_json
from softrobot_env.identification.errors import size
from softrobot_env.identification.fit.least_squares import Fit
from softrobot_env.identification.fit.model import StaticModel
from softrobot_env.identification.fit.path import identify
from softrobot_env.identification.fit.unknowns import FRICTIONS
from softrobot_env.identification.fit.validation import blocks_of, fitted_without
from softrobot_env.recordings import read_recording
from softrobot_env.rendering.tables import text_page
from softrobot_env.robots import find_robot
from studies.lab import Record, quantity, table

_STAGES = ("frame", "tendons", "geometry", "statics")
_PLACE = 2e-4  # m, by which a guide may be off
_STEP = 0.1  # of a prior's deviation, of differences


@dataclass(frozen=True, kw_only=True)
class EffectRow(Record):
    """What an effect changes.

    Attributes:
        effect: In words.
        parameters: Its number of them.
        fitted: [m], RMS of all rows.
        left_out: [m], of blocks that were left out with their neighbours.
        apart: [m], of the patterns apart; None without any.
        largest: Parameter farthest from zero, over the deviation of its prior; None of none.
    """

    effect: str
    parameters: int = quantity("", "d")
    fitted: float = quantity("mm", ".2f")
    left_out: float = quantity("mm", ".2f", "blocks left out")
    apart: float | None = quantity("mm", ".2f", "patterns apart")
    largest: float | None = quantity("", ".1f")


class Effects:
    """Changes of the simulated marker at the end (t, 3, n) [m] by effects, each of a deviation.

    Args:
        model: Of what was identified, driven by length.
        fit: There.
    """

    def __init__(self, model: StaticModel, fit: Fit) -> None:
        self.model, self.x = model, fit.x
        recording, body = model.recording, model.body(fit.x)
        names, columns = model.robot.tendon_names, recording.header.commands.columns
        self.order = [names.index(name) for name in recording.tendons or columns]
        self.commands, self.begins = recording.controls(model.robot), recording.begins
        self.here = model.simulate(fit.x)
        self.turns = self.here.turns.reshape(len(self.commands), -1, 3)
        edges = np.append(0.0, np.cumsum(model.layout.sizes))
        ends = model.robot.backbone.ends
        self.section = np.searchsorted(ends[1:-1], edges[:-1] + model.layout.sizes / 2)
        self.last, self.x_y = model.layout.last, body.place.real
        self.elapsed = recording.times / max(np.ptp(recording.times), 1e-9) - 0.5
        self.spring, self.pretension = body.spring.real, body.pretension.real
        self.offset = body.marker[-1].real

    def all(self) -> Iterator[tuple[str, ndarray]]:
        """Effects in words, and what they change."""
        commands, none = self.commands, np.zeros((len(self.commands), 3, 0))
        stretch = np.maximum(self._tension(), 0) / self.spring
        wound, drift = self._bends().sum(axis=2), self.elapsed[:, None] + 0 * commands
        rubs = 0.1 * stretch * self._sides()
        yield "as it is", none
        yield "servos are read later, each (0.1 s)", self._pulled(self._rates() * 0.1)
        yield "scale of each column (3 %)", self._pulled(0.03 * commands)
        yield "the same, pulled in alone", self._pulled(0.03 * np.maximum(commands, 0))
        yield "zeros of servos drift evenly", self._pulled(_PLACE * drift)
        yield "the frame drifts evenly", self._frame()
        yield "tendons stiffen as they tighten", self._pulled(stretch**2 / stretch.max())
        yield "friction grows with tension", self._pulled(rubs)
        yield "... and with the angle it winds by", self._pulled(rubs * wound)
        yield "guides are wider than tendons", self._changed([-_PLACE * wound])
        yield "guides of tendons that pass are off", self._changed(self._places())
        yield "discs are turned, as one for all that pass", self._changed(self._turned_discs())
        yield "lengths of sections (2 %)", self._shaped(length=0.02)
        yield "ends of sections do not bend (3 mm)", self._shaped(stiff=3e-3)
        yield "sections are twisted (0.1 rad)", self._shaped(twist=0.1)

    def _changed(self, pulls: list[ndarray]) -> ndarray:
        """Central differences by tendons pulled in by so much, (t, n_tendons) [m] each."""
        return np.stack([self._moved(pull) for pull in pulls], axis=-1)

    def _moved(self, pull: ndarray) -> ndarray:
        """(t, 3) [m] by a pull (t, n_tendons) [m]."""
        recording = self.model.recording
        ends = []
        for step in (_STEP, -_STEP):
            changed = recording.commands + step * pull[:, self.order]
            model = self.model.on(replace(recording, commands=changed))
            ends.append(model.simulate(self.x).markers[:, -1])
        return (ends[0] - ends[1]) / (2 * _STEP)

    def _pulled(self, pull: ndarray) -> ndarray:
        """The same, each tendon for itself."""
        return self._changed([pull * one for one in np.eye(pull.shape[1])])

    def _rates(self) -> ndarray:
        """(t, n_tendons) [m/s] of the commands."""
        return np.gradient(self.commands, self.model.recording.times, axis=0)

    def _bends(self) -> ndarray:
        """(t, n_tendons, n) [rad] that tendons wind by in each piece."""
        passes = np.arange(self.turns.shape[1]) < self.last[:, None]
        return norm(self.turns[:, None, :, :2], axis=3) * passes

    def _shortened(self) -> ndarray:
        """(t, n_tendons) [m] that tendons are shorter by the bends, of a continuous channel."""
        x, y = self.x_y.T[..., None]
        turns = self.turns[:, None]
        passes = np.arange(self.turns.shape[1]) < self.last[:, None]
        return ((turns[..., 1] * x - turns[..., 0] * y) * passes).sum(axis=2)

    def _tension(self) -> ndarray:
        """(t, n_tendons) [N], without friction."""
        return self.pretension + self.spring * (self.commands - self._shortened())

    def _sides(self) -> ndarray:
        """(t, n_tendons) in [-1, 1], to which side tendons slid last; lets go of more if 1."""
        sides, short = np.zeros_like(self.commands), self._shortened()
        for row in range(1, len(sides)):
            way = (short[row - 1] - short[row]) / self.model.layout.loose
            sides[row] = 0.0 if self.begins[row] else np.clip(sides[row - 1] + way, -1, 1)
        return sides

    def _inside(self, section: int, off: ndarray) -> ndarray:
        """(t, n_tendons) [m] pulled in, of tendons off (n_tendons, 2) [m] in a section."""
        bend = self.turns[:, self.section == section].sum(axis=1)
        return bend[:, :1] * off[:, 1] - bend[:, 1:2] * off[:, 0]

    def _passing(self) -> Iterator[tuple[int, int]]:
        """Sections and tendons that pass their end."""
        for section in range(self.section.max()):
            for tendon in np.flatnonzero(self.last > np.sum(self.section <= section)):
                yield section, int(tendon)

    def _places(self) -> list[ndarray]:
        """Each place of a tendon that passes a section is off, by itself."""
        found = []
        for section, tendon in self._passing():
            for axis in range(2):
                off = np.zeros_like(self.x_y)
                off[tendon, axis] = _PLACE
                found.append(self._inside(section, off))
        return found

    def _turned_discs(self) -> list[ndarray]:
        """Tendons that end at one place are turned together in a section that they pass."""
        across = 0.05 * np.stack([-self.x_y[:, 1], self.x_y[:, 0]], axis=1)
        kinds = sorted({(section, int(self.last[tendon])) for section, tendon in self._passing()})
        return [self._inside(s, across * (self.last == end)[:, None]) for s, end in kinds]

    def _frame(self) -> ndarray:
        """Shifts by 2 mm and turns by 0.02 rad about each axis, over the recording."""
        end = self.here.markers[:, -1]
        moves = [2e-3 * one + 0 * end for one in np.eye(3)]
        turns = [0.02 * np.cross(one, end) for one in np.eye(3)]
        return np.stack([self.elapsed[:, None] * move for move in moves + turns], axis=-1)

    def _shaped(self, length: float = 0.0, stiff: float = 0.0, twist: float = 0.0) -> ndarray:
        """By a share more of a section's length, an end that does not bend [m], or twist [rad]."""
        plain = self._end(self.model.layout.sizes, self.turns, np.zeros(len(self.section)))
        found = []
        for section in range(self.section.max() + 1):
            own = self.section == section
            sizes = self.model.layout.sizes * (1 + _STEP * length * own)
            turns = self.turns + (_STEP * twist / own.sum() * own)[:, None] * np.eye(3)[2]
            first = np.arange(len(own)) == np.argmax(own)
            last = np.arange(len(own)) == len(own) - 1 - np.argmax(own[::-1])
            for straight in (first, last) if stiff else (0 * first,):
                ends = self._end(sizes, turns, _STEP * stiff * straight)
                found.append((ends - plain) / _STEP)
        return np.stack(found, axis=-1)

    def _end(self, sizes: ndarray, turns: ndarray, straight: ndarray) -> ndarray:
        """(t, 3) [m] of the marker, if each piece begins straight for so far."""
        place, axes = np.zeros((len(turns), 3)), Rotation.identity(len(turns))
        up = np.eye(3)[2] + 0 * place
        for piece, phi in enumerate(turns.swapaxes(0, 1)[: self.model.layout.nodes[-1]]):
            angle = norm(phi, axis=1, keepdims=True) + 1e-9
            across = np.cross(phi, up)
            along = np.cross(phi, across)
            bent = up + (1 - np.cos(angle)) / angle**2 * across
            bent += (angle - np.sin(angle)) / angle**3 * along
            way = (sizes[piece] - straight[piece]) * bent + straight[piece] * up
            place, axes = place + axes.apply(way), axes * Rotation.from_rotvec(phi)
        return place + axes.apply(self.offset + 0 * place)


class Judge:
    """Linear fits about what was identified, with further parameters of deviation one."""

    def __init__(self, model: StaticModel, fit: Fit, apart: str | None) -> None:
        found = model.simulate(fit.x, fit.free)
        self.error, self.slopes = found.error[:, -1], found.slopes[:, -1]
        free = fit.free
        self.prior = inv(model.unknowns.prior[np.ix_(free, free)])
        self.away = fit.x[free] - model.unknowns.mean[free]
        self.weights, self.blocks = fit.weights, blocks_of(model.recording)
        patterns = model.recording.patterns.astype(str)
        self.apart = np.char.startswith(patterns, apart) if apart else np.zeros(len(patterns), bool)

    def row(self, effect: str, change: ndarray) -> EffectRow:
        """An effect that changes the marker by (t, 3, n) [m]."""
        everywhere = np.ones(len(self.blocks), bool)
        left, found = self._left(change, everywhere)
        out = np.empty_like(left)
        for block in range(self.blocks.max() + 1):
            own = self.blocks == block
            out[own] = self._left(change, fitted_without(self.blocks, block))[0][own]
        apart = self._left(change, ~self.apart)[0][self.apart]
        return EffectRow(
            effect=effect,
            parameters=len(found),
            fitted=size(left),
            left_out=size(out),
            apart=size(apart) if self.apart.any() else None,
            largest=float(np.abs(found).max()) if len(found) else None,
        )

    def _left(self, change: ndarray, used: ndarray) -> tuple[ndarray, ndarray]:
        """Errors (t, 3) after a fit of used rows (t,), and the effect's parameters (n,)."""
        slopes, own = np.concatenate([self.slopes, change], axis=2), len(self.prior)
        normal = np.eye(slopes.shape[2])
        normal[:own, :own] = self.prior
        right = np.zeros(len(normal))
        right[:own] = self.prior @ self.away
        counts = used[:, None] & np.isfinite(self.error)
        square = np.nansum(self.error**2, axis=1, keepdims=True) / self.weights.scale**2
        heavy = (counts / np.sqrt(1 + square))[counts] / self.weights.deviation**2
        rows = slopes[counts]
        normal += rows.T @ (heavy[:, None] * rows)
        right += rows.T @ (heavy * self.error[counts])
        step = solve(normal, right)
        return self.error - slopes @ step, -step[own:]


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--header", type=Path)
    parser.add_argument("--robot", required=True)
    parser.add_argument("--apart", help="how names of patterns begin that others predict")
    parser.add_argument("--out", type=Path, default=Path("out"))
    parser.add_argument("--overwrite", action="store_true")
    args = parser.parse_args()
    recording = read_recording(args.recording, args.header)
    found = identify(recording, find_robot(args.robot), _STAGES, validate=False)
    if found.recording.drive(found.believed) != "length":
        parser.error("effects are those of a robot driven by length")
    place = found.unknowns.place
    known = [name for name in FRICTIONS if not found.fit.free[place(name) or slice(0)].any()]
    turned = "as said" if found.assignment is None else "about the axis"
    model = StaticModel(found.believed, found.recording, turned, known=known)
    judge = Judge(model, found.fit, args.apart)
    rows = [judge.row(effect, change) for effect, change in Effects(model, found.fit).all()]
    columns = ("effect", "parameters", "fitted", "left_out", "apart", "largest")
    (shown,) = table("What further effects would change", *columns)(rows)
    command = "python scripts/effects.py " + " ".join(sys.argv[1:])
    out = args.out / "effects"
    with new_results(out, args.overwrite):
        write_json(out / "report.json", [row.row() for row in rows], command)
        write_text(out / "report.md", text_page("Effects beside the model", shown, command))
    print((out / "report.md").read_text())


if __name__ == "__main__":
    main()
