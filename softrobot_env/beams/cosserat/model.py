"""Cosserat rod on a staggered grid with quaternions (thesis sec. 2.2; Lang et al. 2011)."""

from collections.abc import Sequence

import numpy as np
from numpy import ndarray

from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load

from .. import mechanics
from ..actuation import Actuation, channel_samples
from ..model import BeamModel, in_pieces, masses_at
from . import dynamics
from .dynamics import CosseratData

#: Where the rod bends; see `cosserat.dynamics`.
GRIDS = ("middles", "thesis")
#: How the moments act on the sections.
MOMENTS = ("conservative", "printed")


#: Pieces between two guides, at least.
_PER_SPAN = 2

#: From the middle of a piece towards the end of a pair, over its length. Bent at 1/6 and 5/6 a span
#: shortens, and has moment arms, as an arc does to second order of its angle.
_OUTWARDS = 2 / 3 - 0.5


class CosseratRod(BeamModel):
    """Shear, tension, bending and torsion of any size.

    Coordinates come in blocks of seven, [x_n (3), p_n-1/2 (4)] for n = 1 .. pieces: the end of
    each segment and the quaternion of its section. A free base adds a last block [x_0 (3)].

    The pieces are equal in each section. Where tendons run through guides the moment has a kink at
    each guide and is nearly a parabola in between: guides are ends of pieces as well, if there are
    two pieces or more for each span, and each pair of pieces of a span bends at 1/6 and 5/6, not in
    the middles of the pieces.

    All errors are of second order in the pieces, but for a moment that follows a section inside a
    piece: it turns with the mean of its neighbours, which is a first-order error.

    Loads and tendons: directors are interpolated linearly between the sections. In the thesis'
    grid they are extrapolated to the tip: a moment there acts on the last section, half a segment
    before it (audit), so under a tip moment that section turns by 1 - 1 / (2 pieces) of the tip's
    angle. Tendon discs beyond that section turn with it.
    """

    def __init__(
        self,
        robot: RobotParams,
        pieces: int | None = None,
        *,
        grid: str | None = None,
        weighting: int = 5,
        moments: str = "conservative",
        shear_coefficient: float = 0.75,
        baumgarte: float = 0.0,
        clamped: bool = True,
        loads: Sequence[Load] = (),
        drive: str = "tension",
    ) -> None:
        """Set up a rod.

        Args:
            robot, pieces, loads, drive: As in `BeamModel`; the pieces are the rod's segments.
            grid: "middles" of the pieces, where the rod bends unless given, or that of the
                "thesis", the only one of a free rod: bending beside the clamp acts at the clamp.
                See `cosserat.dynamics`.
            weighting: 1 to 5, the xi of sec. 2.2.5; the thesis uses 2. The default 5 makes the
                curvature the angle per length, so that a pure moment M bends to M / EI at any
                number of pieces. Of the conservative ones it has the smallest largest error:
                for 5 and 14 pieces the tip of the weak cantilever is off by 12.9 and 1.6 mm
                under its weight (xi_2: 14.2 and 1.9, xi_3: 5.8 and 1.0) and by 5.3 and 0.7 mm
                under a tip moment that bends it to a half circle (xi_2: 7.3 and 1.0, xi_3: 58.8
                and 9.6). xi_3 grows without bound where sections turn by 180 degrees against
                each other.
            moments: "conservative" takes the gradient of the elastic energy, "printed" the
                torques of (2.37), which are that gradient for weighting 1 only. Those with
                weighting 2 give the numbers of the thesis.
            shear_coefficient: kappa of (2.32), thesis 3/4.
            baumgarte: [1/s], rate at which the quaternions' norm decays to 1; 0 keeps it on
                acceleration level only, as (2.43).
            clamped: Whether the base is fixed, else it moves freely.

        Raises:
            ValueError: An argument is not one of those named.
        """
        if weighting not in (1, 2, 3, 4, 5):
            raise ValueError(f"weighting must be 1, 2, 3, 4 or 5 (xi_1 to xi_5), got {weighting!r}")
        if moments not in MOMENTS:
            raise ValueError(f"unknown moments {moments!r}; choose from {', '.join(MOMENTS)}")
        if not 0 < shear_coefficient < np.inf:
            raise ValueError(f"shear_coefficient must be positive, got {shear_coefficient!r}")
        if not 0 <= baumgarte < np.inf:
            raise ValueError(f"baumgarte must be zero or a positive rate, got {baumgarte!r}")
        if grid is None:
            grid = "middles" if clamped else "thesis"
        if grid not in GRIDS:
            raise ValueError(f"unknown grid {grid!r}; choose from {', '.join(GRIDS)}")
        if grid == "thesis":
            robot.require_uniform("CosseratRod with the grid 'thesis'")
        if grid == "middles" and not clamped:
            raise ValueError("a free rod has the grid 'thesis', with a vertex at each end")
        self.grid, self.weighting, self.moments = grid, int(weighting), moments
        self.shear_coefficient, self.baumgarte = float(shear_coefficient), float(baumgarte)
        self.clamped = bool(clamped)
        super().__init__(robot, pieces, loads, drive)

    def _data(self, actuation: Actuation) -> CosseratData:
        robot, pieces, backbone = self.robot, self.pieces, self.robot.backbone
        sizes, vertices = np.diff(self.edges), self._vertices()
        segments, cells, stub = np.diff(vertices), sizes.copy(), float(vertices[0])
        if not stub:
            cells[0] /= 2
        # All of the rod stretches: the first segment for the stub, too.
        stretched = np.append(0.0, vertices[1:])
        give = (
            backbone.integrals(lambda s, f=f: 1 / f(s), stretched)
            for f in (backbone.shear, backbone.axial)
        )
        shear, axial = (segments / x for x in give)
        bending = backbone.in_series(backbone.bending, self.edges)
        torsion = backbone.in_series(backbone.torsion, self.edges)
        mass, inertia = self._inertia(vertices)
        rotary = float(backbone.integrals(backbone.rotary, self.edges).sum())
        scale = np.tile([robot.length] * 3 + [1.0] * 4, pieces)
        places = self._places(actuation.point_station)
        actuation, samples = self._samples(actuation, vertices)
        if self.grid == "thesis":  # discs turn with the last section
            weights = places["weight"][actuation.first[0] : actuation.first[-1]]
            np.minimum(weights, 1.0, out=weights)
        return CosseratData(
            n=7 * pieces + (0 if self.clamped else 3),
            block=7,
            reach=self._reach(actuation, places),
            scale=scale if self.clamped else np.append(scale, [robot.length] * 3),
            actuation=actuation,
            pieces=pieces,
            base=-1 if self.clamped else 7 * pieces,
            spacing=robot.length / pieces,
            stub=stub,
            segments=segments,
            cells=cells,
            vertex_mass=mass,
            inertia=inertia,
            normal_inertia=4 * rotary / pieces,
            stretching=np.column_stack([*[self.shear_coefficient * shear] * 2, axial]),
            bending=np.column_stack([bending, bending, torsion]),
            stretch_damping=backbone.damping(backbone.axial, stretched),
            bend_damping=backbone.damping(backbone.bending, self.edges),
            gravity=np.array(robot.own_gravity, float),
            weighting=self.weighting,
            conservative=self.moments == "conservative",
            baumgarte=self.baumgarte,
            norm_stiffness=0.0,
            **places,
            **samples,
        )

    @classmethod
    def fewest(cls, robot: RobotParams) -> int:
        """See `BeamModel`: two for each span between guides."""
        spans = len(_span_ends(robot)) - 1
        return _PER_SPAN * spans if any(t.guides for t in robot.tendons) else 1

    def _cut(self) -> ndarray:
        """See `BeamModel`."""
        self._paired = np.zeros(self.pieces, bool)
        least = self.fewest(self.robot)
        if self.grid == "thesis" or least == 1 or self.pieces < least:
            return super()._cut()
        ends = _span_ends(self.robot)
        sizes, counts = np.diff(ends), np.full(len(ends) - 1, _PER_SPAN)
        while counts.sum() < self.pieces:  # to the span with the longest pieces
            left = self.pieces - counts.sum()
            counts[np.argmax(sizes / counts)] += min(_PER_SPAN, left)
        self._paired = np.repeat(counts % 2 == 0, counts)
        parts = (e + d / n * np.arange(n) for e, d, n in zip(ends, sizes, counts, strict=False))
        return np.append(np.concatenate(list(parts)), ends[-1])

    def _vertices(self) -> ndarray:
        """Arc lengths (N + 1,) [m] of the vertices."""
        if self.grid == "thesis":
            return self.edges
        middles, sizes = (self.edges[:-1] + self.edges[1:]) / 2, np.diff(self.edges)
        second = np.cumsum(self._paired) % 2 == 0
        shift = np.where(second, _OUTWARDS, -_OUTWARDS) * sizes * self._paired
        return np.append(middles + shift, self.edges[-1])

    def _inertia(self, vertices: ndarray) -> tuple[ndarray, ndarray]:
        """Masses (N + 1,) [kg] of the vertices and inertias (N, 3) [kg m2] of the segments.

        The inertia of a disc is shared out between the sections beside it.
        """
        backbone, pieces = self.robot.backbone, self.pieces
        inertia = np.outer(backbone.integrals(backbone.rotary, vertices), [1.0, 1.0, 2.0])
        for disc in self.robot.discs:
            place = {k: x[0] for k, x in self._places(np.array([disc.station])).items()}
            section, weight = place["section"], np.clip(place["weight"], 0.0, 1.0)
            for k, part in ((section, 1 - weight), (section + 1, weight)):
                if 0 <= k < pieces:
                    inertia[k] += part * np.array(disc.inertia)
        return masses_at(self.robot, vertices), inertia

    def _places(self, stations: ndarray) -> dict[str, ndarray]:
        """Fields of `CosseratData` about points at stations (k,) [m]."""
        at = in_pieces(stations, self.edges)
        if self.grid == "middles":
            return _middle_places(at, self.edges, self._vertices())
        return _thesis_places(at, self.pieces, self.clamped)

    def _strain_shares(self, edges: ndarray, vertices: ndarray) -> ndarray:
        """Shear and stretch (k, 2) [1] between edges over that of the segment they are in."""
        if self.robot.is_uniform:
            return np.ones((len(edges) - 1, 2))
        backbone = self.robot.backbone
        middles = (edges[:-1] + edges[1:]) / 2
        number = np.maximum(np.searchsorted(vertices, middles) - 1, 0)
        shares = [
            backbone.in_series(of, vertices)[number] / backbone.in_series(of, edges)
            for of in (backbone.shear, backbone.axial)
        ]
        return np.column_stack(shares)

    def _samples(
        self, actuation: Actuation, vertices: ndarray
    ) -> tuple[Actuation, dict[str, ndarray]]:
        """The actuation with samples of the channels, and fields of `CosseratData` about these.

        Half a segment bends with each of its vertices; where the place of a channel in a uniform
        rod is constant one sample stands for both.
        """
        robot, halves = self.robot, (vertices[:-1] + vertices[1:]) / 2
        if self.grid == "middles":
            halves = self.edges[1:]
        whole = np.unique(np.append(0.0, vertices))  # the stub, then segments
        edges = np.union1d(whole, halves)
        found = channel_samples(robot, actuation, edges, whole if robot.is_uniform else edges)
        segment = np.searchsorted(vertices, found.station)  # 0 in the stub
        beyond = found.station - np.append(np.inf, halves)[segment]
        straight = np.array([t.is_straight for t in robot.tendons], bool)[found.tendon]
        second = np.where(straight, np.clip(0.5 + beyond / found.size, 0.0, 1.0), beyond > 0)
        shares = self._strain_shares(edges, vertices)[np.searchsorted(edges, found.station) - 1]
        return actuation._replace(sampled=found.tendon, sample_size=found.size), {
            "first_sample": np.searchsorted(segment, np.arange(self.pieces + 2)),
            "samples": np.column_stack([second, shares, found.place]),
        }

    def _reach(self, actuation: Actuation, places: dict[str, ndarray]) -> int:
        """Distance in blocks over which equations depend on coordinates, given `_places`."""
        if not self.clamped:
            return self.pieces + 1  # the base comes last
        if actuation.by_length and len(actuation.straight):
            return self.pieces
        vertex, share, section, weight = (
            places[name] for name in ("vertex", "share", "section", "weight")
        )
        blocks = np.stack([vertex - 1, vertex, section, section + 1])
        used = np.stack([share != 1, share != 0, weight != 1, weight != 0]) & (blocks >= 0)
        low = np.where(used, blocks, self.pieces).min(axis=0)
        high = np.where(used, blocks, -1).max(axis=0)
        least = 2 if len(actuation.sampled) else 1
        return min(self.pieces, max(least, actuation.reach(low, high)))

    def moved(self, q: ndarray, change: ndarray) -> ndarray:
        """Coordinates (n,) changed by (n,) in their strains and rotations."""
        out = np.empty(self.n)
        dynamics.displace(self.data, q, change, out)
        return out

    def static_data(self, data: CosseratData) -> CosseratData:
        """Data with a stiffness of the quaternions' norm, which statics leave free otherwise."""
        return data._replace(norm_stiffness=4 * float(data.bending.max()) / data.spacing)

    def rest(self) -> ndarray:
        """Coordinates (n,) of the straight pose."""
        q = np.zeros(self.data.n)
        blocks = q[: 7 * self.pieces].reshape(-1, 7)
        blocks[:, 2] = np.cumsum(self.data.segments)
        blocks[:, 3] = 1
        return q

    def tangent(self, q: ndarray) -> ndarray:
        """(n, m): columns move one vertex along an axis or turn one section about its own axis."""
        out = np.zeros((self.n, self.n - self.pieces))
        for k in range(self.pieces):
            p0, p1, p2, p3 = q[7 * k + 3 : 7 * k + 7]
            out[7 * k : 7 * k + 3, 6 * k : 6 * k + 3] = np.eye(3)
            out[7 * k + 3 : 7 * k + 7, 6 * k + 3 : 6 * k + 6] = 0.5 * np.array(
                [[-p1, -p2, -p3], [p0, -p3, p2], [p3, p0, -p1], [-p2, p1, p0]]
            )
        out[7 * self.pieces :, 6 * self.pieces :] = np.eye(self.n - 7 * self.pieces)
        return out

    def vertex_curvature(self, q: ndarray) -> ndarray:
        """Curvature (pieces, 3) [1/m] about x, y, z at the vertices 0 to pieces - 1, (2.23)."""
        return self._curvatures(q, self.weighting)

    def curvature(self, q: ndarray) -> ndarray:
        """Curvature (pieces, 3) [1/m] about x, y, z of each segment.

        In the thesis' grid the mean of its two vertices; the last segment, and the first of a free
        rod, have that of their inner vertex, which is exact where the curvature is constant.
        """
        kappa = self.vertex_curvature(q)
        if self.grid == "middles":
            return kappa
        mean = kappa.copy()
        mean[:-1] = (kappa[:-1] + kappa[1:]) / 2
        if not self.clamped and self.pieces > 1:
            mean[0] = kappa[1]
        return mean

    def twist(self, q: ndarray) -> float:
        """Torsion angle [rad] from clamp to tip.

        In the thesis' grid a moment at the tip acts on the last section, half a segment before
        it. The angle there is extrapolated to the tip, exactly for constant torsion.
        """
        kappa = self._curvatures(q, 5)[:, 2]
        if self.grid == "middles":
            return float(self.data.cells @ kappa)
        turns = self.data.spacing * kappa
        return float(turns.sum() - turns[0] / 2 + turns[-1] / 2)

    def constraint_drift(self, q: ndarray) -> float:
        """Largest deviation of the norm of a quaternion in q (n,) or (T, n) from 1."""
        blocks = np.atleast_2d(q)[:, : 7 * self.pieces].reshape(-1, 7)
        return float(np.max(np.abs(np.linalg.norm(blocks[:, 3:], axis=1) - 1)))

    def _curvatures(self, q: ndarray, weighting: int) -> ndarray:
        u = dynamics.sections(np.ascontiguousarray(q, float), self.pieces)
        return dynamics.curvatures(u, self.data.base, self.data.cells, weighting)[:-1]


def _span_ends(robot: RobotParams) -> ndarray:
    """Arc lengths (k,) [m] of the ends of robot, sections and spans between guides."""
    guides = [station for t in robot.tendons if t.guides for station in t.stations]
    ends = np.unique([*robot.backbone.ends, *guides])
    apart = np.diff(ends, prepend=-1.0) > 1e-9 * robot.length
    return ends[apart]


def _middle_places(at: ndarray, edges: ndarray, vertices: ndarray) -> dict[str, ndarray]:
    """Fields of `CosseratData` about points at places (k,) in pieces, in the grid "middles".

    Segment k turns with the section at the end of piece k.
    """
    pieces = len(edges) - 1
    s = np.interp(at, np.arange(pieces + 1), edges)
    vertex = np.clip(np.searchsorted(vertices, s, side="right") - 1, 0, pieces - 1)
    share = in_pieces(s, vertices) - vertex
    section = np.minimum(at.astype(int), pieces - 1) - 1
    return {
        "vertex": vertex,
        "share": share,
        "shift": np.minimum(s, vertices[0]),
        "section": section,
        "weight": at - section - 1,
    }


def _thesis_places(at: ndarray, pieces: int, clamped: bool) -> dict[str, ndarray]:
    """Fields of `CosseratData` about points at places (k,) in pieces, in the grid "thesis".

    Directors are interpolated linearly between the clamp and the middles of the segments and
    extrapolated beyond the last. The discs of a tendon beyond it turn with the last section: the
    half segment at the tip cannot bend, and a moment on extrapolated directors would bend the
    last vertex half as much again.
    """
    vertex = np.minimum(at.astype(int), pieces - 1)
    lowest = -1 if clamped or pieces == 1 else 0
    section = np.maximum(np.minimum(np.floor(at - 0.5).astype(int), pieces - 2), lowest)
    weight = np.where(section < 0, 2 * at, at - 0.5 - section)
    if pieces == 1 and not clamped:
        weight = np.ones_like(at)  # one section for all
    return {
        "vertex": vertex,
        "share": at - vertex,
        "shift": np.zeros_like(at),
        "section": section,
        "weight": weight,
    }


mechanics.implement(CosseratData, dynamics)
