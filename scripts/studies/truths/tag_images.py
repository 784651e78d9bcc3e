"""Pictures of tags as a camera would take them, from the poses that they are drawn at.

Each pixel is the mean over its area: rays through a fine grid of it are followed from the camera,
bent as its lens does, to the planes of the tags. Nothing of OpenCV projects anything here.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

#: White paper around a tag, over its side.
MARGIN = 0.25

_WHITE, _BLACK, _BACKGROUND = 225.0, 25.0, 110.0
_FIXED_POINTS = 8  # iterations that undo the lens


@dataclass(frozen=True)
class Lens:
    """A pinhole with radial and tangential distortion, by Brown.

    Attributes:
        size: (width, height) of a picture [pixels].
        focal: (fx, fy) [pixels].
        center: (cx, cy) [pixels], where (0, 0) is the middle of the first pixel.
        bend: k1, k2, p1, p2, k3.
    """

    size: tuple[int, int] = (1280, 960)
    focal: tuple[float, float] = (1150.0, 1152.0)
    center: tuple[float, float] = (644.0, 475.0)
    bend: tuple[float, ...] = (-0.12, 0.05, 0.0008, -0.0006, 0.0)

    def distorted(self, x: ndarray, y: ndarray) -> tuple[ndarray, ndarray]:
        """Where rays (x, y, 1) meet the picture at focal length 1."""
        k1, k2, p1, p2, k3 = self.bend
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return (
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        )

    def pixels(self, points: ndarray) -> ndarray:
        """Pixels (n, 2) of points (n, 3) [m] in front of the camera."""
        bent = self.distorted(*(points[:, :2] / points[:, 2:]).T)
        return np.array(self.focal) * np.stack(bent, 1) + np.array(self.center)

    def rays(self, pixels: ndarray) -> ndarray:
        """Rays (n, 3), of depth 1, that meet pixels (n, 2)."""
        wanted = ((pixels - np.array(self.center)) / np.array(self.focal)).T
        x, y = wanted
        for _ in range(_FIXED_POINTS):
            bent_x, bent_y = self.distorted(x, y)
            x = x + wanted[0] - bent_x
            y = y + wanted[1] - bent_y
        return np.stack([x, y, np.ones_like(x)], 1)


def picture(
    lens: Lens,
    sheets: Mapping[str, tuple[ndarray, float, ndarray]],
    rng: np.random.Generator,
    noise: float = 2.0,
    blur: float = 0.6,
    count: int = 25,
) -> ndarray:
    """A grey picture (height, width) of flat sheets.

    Args:
        lens: The camera.
        sheets: By any name, the cells of a sheet (rows, columns), True where white, the side of a
            cell [m], and its pose (4, 4) in the camera's frame: x to the right of the sheet, y up,
            z towards whom it faces, from its middle. Paper around it is white.
        rng: Of the noise.
        noise: Standard deviation [grey levels].
        blur: Standard deviation [pixels] of the lens.
        count: Rays of a pixel.
    """
    width, height = lens.size
    image = np.full((height, width), _BACKGROUND)
    for cells, length, pose in sheets.values():
        _draw(image, lens, cells, length, pose, count)
    image = gaussian_filter(image, blur) + noise * rng.standard_normal(image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def _draw(
    image: ndarray, lens: Lens, cells: ndarray, length: float, pose: ndarray, count: int
) -> None:
    turn, place = pose[:3, :3], pose[:3, 3]
    half = length * np.array(cells.shape[::-1]) / 2
    edge = half + MARGIN * 2 * half.min()
    ends = np.array([[sx, sy, 0.0] for sx in (-1, 1) for sy in (-1, 1)]) * [*edge, 0.0]
    around = lens.pixels(ends @ turn.T + place)
    low = np.maximum(np.floor(around.min(0)).astype(int) - 2, 0)
    high = np.minimum(np.ceil(around.max(0)).astype(int) + 3, lens.size)
    if np.any(high <= low):
        return
    columns, rows = np.meshgrid(*(np.arange(a, b) for a, b in zip(low, high, strict=True)))
    found = image[low[1] : high[1], low[0] : high[0]]
    total = np.zeros(found.shape)
    for dx, dy in _spread(count):
        pixels = np.stack([columns.ravel() + dx, rows.ravel() + dy], 1)
        total += _seen(lens.rays(pixels), cells, half, edge, pose, found)
    image[low[1] : high[1], low[0] : high[0]] = total / count


def _spread(count: int) -> ndarray:
    """Places (count, 2) in a pixel, all in other rows and columns of it (Roberts' sequence).

    On a square grid, edges that lie along the pixels would be off by a tenth of one.
    """
    ratio = 1.32471795724474602596
    numbers = np.arange(1, count + 1)[:, None] * np.array([1 / ratio, 1 / ratio**2])
    return numbers % 1 - (numbers % 1).mean(0)


def _seen(
    rays: ndarray, cells: ndarray, half: ndarray, edge: ndarray, pose: ndarray, behind: ndarray
) -> ndarray:
    """Grey levels that rays meet, those of what is behind where they miss the sheet."""
    turn, place = pose[:3, :3], pose[:3, 3]
    depth = (turn[:, 2] @ place) / (rays @ turn[:, 2])
    x, y, _ = ((rays * depth[:, None] - place) @ turn).T
    rows, columns = cells.shape
    column = np.floor((x + half[0]) / (2 * half[0]) * columns).astype(int)
    row = np.floor((half[1] - y) / (2 * half[1]) * rows).astype(int)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    white = np.ones(len(rays), bool)
    white[inside] = cells[row[inside], column[inside]]
    paper = (np.abs(x) < edge[0]) & (np.abs(y) < edge[1]) & (depth > 0)
    grey = np.where(white, _WHITE, _BLACK)
    return np.where(paper, grey, behind.ravel()).reshape(behind.shape)


def pose(place: tuple[float, float, float], turn: Rotation) -> ndarray:
    """(4, 4) of a place [m] and a turn."""
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = turn.as_matrix(), place
    return found


#: A sheet that faces the camera upright: its z points back at it, its y against the picture's.
FACING = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
