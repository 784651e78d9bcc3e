"""A camera that sees tags: what is known of it, and its calibration with a printed board."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.core.extras import needed
from softrobot_env.core.files import read_table, readable, text, write_text
from softrobot_env.core.records import Count, Positive, Record, Vector2, placed, read, write

#: Squares of the board for calibration, in its two directions.
SQUARES = (9, 6)

#: Dots of a printed sheet along a square of the board, and along the black square of a tag.
SQUARE_DOTS, TAG_DOTS = 360, 480

_MARK = 0.75  # side of a mark of the board over a square's
_FEWEST_IMAGES, _FEWEST_CORNERS = 8, 12
_LAST_TAG = 586  # of family 36h11
_CELLS, _MARGIN = 8, 2  # of a tag, along its black square, and of white around


def opencv() -> ModuleType:
    """OpenCV, on one thread.

    Raises:
        ImportError: It is not installed; the message tells how it is.
    """
    with needed("tag cameras need OpenCV", "camera"):
        import cv2
    cv2.setNumThreads(1)  # pictures are small
    return cv2


@dataclass(frozen=True)
class Camera(Record):
    """A pinhole with Brown's distortion, as OpenCV has it.

    Attributes:
        size: (width, height) of its pictures [pixels].
        focal: (fx, fy) [pixels].
        center: (cx, cy) [pixels]; (0, 0) is the middle of the first pixel.
        distortion: k1, k2, p1, p2, k3 [1].
        error: [pixels], root mean square, with which it was calibrated.
        uncertainty: Standard deviation [pixels] of the focal lengths.
    """

    size: tuple[Count, Count]
    focal: tuple[Positive, Positive]
    center: Vector2
    distortion: tuple[float, float, float, float, float]
    error: float = 0.0
    uncertainty: float = 0.0

    @property
    def matrix(self) -> ndarray:
        """(3, 3), from rays to pixels."""
        matrix = np.diag([*self.focal, 1.0])
        matrix[:2, 2] = self.center
        return matrix


def read_camera(path: Path) -> Camera:
    """The camera that a TOML file describes; errors as of `robot_file.read_robot_file`."""
    with placed(path):
        return read(Camera, read_table(path))


def write_camera(camera: Camera, path: Path) -> None:
    """Write a file that `read_camera` reads."""
    write_text(path, text(write(camera, full=True)))


def tag_dictionary() -> Any:
    """The tags of family 36h11, for OpenCV."""
    return opencv().aruco.getPredefinedDictionary(opencv().aruco.DICT_APRILTAG_36h11)


def check_tag(number: object) -> None:
    """Raise ValueError for what is no number of a tag of the family."""
    if not isinstance(number, int) or not 0 <= number <= _LAST_TAG:
        raise ValueError(f"tags have numbers from 0 to {_LAST_TAG}, got {number!r}")


def tag_sheet(number: int) -> ndarray:
    """A grey picture of a tag with its margin.

    Raises:
        ValueError: There is no such tag.
    """
    check_tag(number)
    cells = opencv().aruco.generateImageMarker(tag_dictionary(), number, _CELLS)
    dots = np.ones((TAG_DOTS // _CELLS, TAG_DOTS // _CELLS), np.uint8)
    return np.kron(np.pad(cells, _MARGIN, constant_values=255), dots)


def board_sheet() -> ndarray:
    """A grey picture of the board."""
    return _board(1.0).generateImage((SQUARES[0] * SQUARE_DOTS, SQUARES[1] * SQUARE_DOTS))


def _board(square: float) -> Any:
    aruco = opencv().aruco
    marks = aruco.getPredefinedDictionary(aruco.DICT_4X4_50)
    return aruco.CharucoBoard(SQUARES, square, _MARK * square, marks)


def calibrated(paths: Sequence[Path], square: float) -> tuple[Camera, list[Path]]:
    """The camera that took pictures of the board, and which of them do not show it.

    Args:
        paths: The pictures, all of one size.
        square: Side [m] of a printed square, as measured.

    Raises:
        ValueError: Too few show the board, they differ in size, or one is no picture.
        OSError: One cannot be read.
    """
    cv2, board = opencv(), _board(square)
    detector = cv2.aruco.CharucoDetector(board)
    size, points, unseen = None, [], []
    for path in paths:
        image = cv2.imread(str(readable(path)), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise ValueError(f"{path}: no picture that OpenCV reads")
        size = size or image.shape[::-1]
        if image.shape[::-1] != size:
            raise ValueError(f"{path} has {image.shape[::-1]} pixels, others have {size}")
        corners, numbers, _, _ = detector.detectBoard(image)
        if numbers is None or len(numbers) < _FEWEST_CORNERS:
            unseen.append(path)
        else:
            points.append(board.matchImagePoints(corners, numbers))
    if len(points) < _FEWEST_IMAGES:
        raise ValueError(
            f"{len(points)} pictures show {_FEWEST_CORNERS} corners of the board or more, "
            f"{_FEWEST_IMAGES} are needed"
        )
    known, seen = zip(*points, strict=True)
    found = cv2.calibrateCameraExtended(known, seen, size, None, None)
    error, matrix, bend, deviation = found[0], found[1], found[2].ravel()[:5], found[5].ravel()
    focal, center = np.diag(matrix)[:2].tolist(), matrix[:2, 2].tolist()
    return Camera(size, focal, center, bend.tolist(), error, float(max(deviation[:2]))), unseen
