"""Tags of AprilTag's family 36h11 on head and base, seen by a camera that stands still."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.records import NotNegative, Positive, check_argument
from softrobot_env.core.registry import is_path, load_given

from .camera import Camera, check_tag, opencv, read_camera, tag_dictionary
from .errors import LinkError
from .tip import PoseTip, TipMeasurement

#: Corners of a tag over half its side: x to the right as one reads it, y up, z towards the reader.
_CORNERS = np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])

_SAMPLES = np.linspace(0.06, 0.94, 48)  # places along an edge where it is looked for
_REACH, _LEAST_REACH = 3.0, 1.5  # pixels, how far, but not beyond the cells beside it:
_CELL = 0.6 / 8  # of a tag's side

_MOST_ERROR = 1.0  # pixels, root mean square, between what is seen and a pose
_TELLING = 0.1  # pixels, by which a second pose has to fit worse
_SAME = 0.02  # rad between two poses that are one

_UNIT, _STRAIGHT = np.eye(3), np.zeros(5)  # of rays, there is no camera left to undo

_BASE_IMAGES = 20  # over which the base is averaged
_MOVED = 3.0  # pixels, by which its tags may seem to move afterwards

#: Waits for a picture, and says when it was taken [s] and what it shows.
Pictures = Callable[[], tuple[float, ndarray]]


class Body(NamedTuple):
    """What carries tags: their size [m], and by their numbers their poses (4, 4) in its frame."""

    size: float
    tags: Mapping[int, ndarray]

    def corners(self, number: int) -> ndarray:
        """Corners (4, 3) [m] of a tag in the body's frame."""
        pose = self.tags[number]
        return self.size / 2 * _CORNERS @ pose[:3, :3].T + pose[:3, 3]


class TagFinder:
    """Finds tags in pictures of a camera, and poses of what carries them."""

    def __init__(self, camera: Camera) -> None:
        self._cv2, self._camera = opencv(), camera
        self._matrix, self._bend = camera.matrix, np.array(camera.distortion)
        self._detector = self._cv2.aruco.ArucoDetector(tag_dictionary())

    def find(self, image: ndarray) -> dict[int, ndarray]:
        """Tags in a grey picture: number -> corners (4, 2) [pixels], to a pixel or so.

        A number that is seen twice is not told: there is another tag of it somewhere.
        """
        corners, numbers, _ = self._detector.detectMarkers(image)
        numbers = [] if numbers is None else numbers.ravel().tolist()
        found = zip(numbers, corners, strict=True)
        return {n: c[0].astype(float) for n, c in found if numbers.count(n) == 1}

    def refine(self, image: ndarray, corners: ndarray) -> ndarray:
        """Rays (4, 2), of depth 1, to corners of a tag: where lines along its edges cross.

        An edge is at the mean of where the picture gets brighter outwards, at places along a side,
        which does not depend on how soft it is or how it lies on the pixels. Corners as OpenCV
        refines them are off by a quarter of a pixel where pictures are soft.
        """
        cv2, side = self._cv2, np.roll(corners, -1, 0) - corners
        length = np.linalg.norm(side, axis=1)
        outwards = np.stack([side[:, 1], -side[:, 0]], 1) / length[:, None]
        reach = min(_REACH, max(_LEAST_REACH, _CELL * length.mean()))
        steps = np.linspace(-reach, reach, 4 * int(np.ceil(reach)) + 1)
        places = corners[:, None] + _SAMPLES[:, None] * side[:, None]
        across = places[:, :, None] + steps[:, None] * outwards[:, None, None]
        across = across.reshape(-1, len(steps), 2).astype(np.float32)
        grey = cv2.remap(image, across, None, cv2.INTER_LINEAR).astype(float)
        brighter = np.diff(grey, axis=1)
        total = np.maximum(brighter.sum(1), 1e-9)
        shift = np.clip(brighter @ (steps[1:] + steps[:-1]) / 2 / total, -reach, reach)
        edges = places + shift.reshape(4, -1, 1) * outwards[:, None]
        rays = cv2.undistortPoints(edges.reshape(-1, 1, 2), self._matrix, self._bend)
        lines = np.array([_line(points) for points in rays.reshape(4, -1, 2)])
        crossings = np.cross(np.roll(lines, 1, 0), lines)
        return crossings[:, :2] / crossings[:, 2:]

    def pose(self, body: Body, rays: Mapping[int, ndarray]) -> ndarray:
        """Pose (4, 4) of a body in the camera's frame.

        Args:
            body: What carries tags.
            rays: Number of a tag -> rays (4, 2) to its corners; one or more.

        Raises:
            ValueError: No pose fits, or two do, as with a small tag that faces the camera.
        """
        points = np.concatenate([body.corners(number) for number in rays])
        seen = np.concatenate(list(rays.values()))
        tried = []
        for start in self._guesses(body, rays):
            turn, place = self._cv2.solvePnPRefineLM(
                points, seen, _UNIT, _STRAIGHT, self._cv2.Rodrigues(start[:3, :3])[0], start[:3, 3:]
            )
            pose = self._matrix_of(turn, place)
            found = points @ pose[:3, :3].T + pose[:3, 3]
            off = np.mean(np.sum((found[:, :2] / found[:, 2:] - seen) ** 2, axis=1))
            tried.append((np.mean(self._camera.focal) * np.sqrt(off), pose))
        best, pose = min(tried, key=lambda one: one[0])
        if not best <= _MOST_ERROR:
            raise ValueError(f"no pose fits, the best errs by {best:.2g} pixels")
        for error, other in tried:
            between = (np.trace(pose[:3, :3].T @ other[:3, :3]) - 1) / 2
            if between < np.cos(_SAME) and error**2 - best**2 < _TELLING**2:
                raise ValueError("two poses fit")
        return pose

    def _guesses(self, body: Body, rays: Mapping[int, ndarray]) -> Iterator[ndarray]:
        """The two poses (4, 4) that each tag alone leaves open."""
        how = self._cv2.SOLVEPNP_IPPE_SQUARE
        for number, seen in rays.items():
            square = body.size / 2 * _CORNERS
            _, *found, _ = self._cv2.solvePnPGeneric(square, seen, _UNIT, _STRAIGHT, flags=how)
            for turn, place in zip(*found, strict=True):
                yield self._matrix_of(turn, place) @ np.linalg.inv(body.tags[number])

    def _matrix_of(self, turn: ndarray, place: ndarray) -> ndarray:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self._cv2.Rodrigues(turn)[0], place[:, 0]
        return pose


def _line(points: ndarray) -> ndarray:
    """(a, b, c) of the line a x + b y + c = 0 through points (n, 2)."""
    middle = points.mean(0)
    normal = np.linalg.svd(points - middle)[2][1]
    return np.append(normal, -normal @ middle)


class TagTip(PoseTip):
    """Tags on the head, and at the base, in pictures of a camera.

    All tags of the head that are seen count together, and orientations are better by several that
    do not lie in one plane. The base is averaged over the first pictures. Pictures without a tag of
    the head, from which its pose cannot be told, or in which the base has moved, are counted in
    `refused`.
    """

    def __init__(
        self,
        camera: str,
        size: float,
        device: int | str | Pictures = 0,
        base_size: float | None = None,
        latency: float = 0.0,
        **bodies: Any,
    ) -> None:
        """Open the camera.

        Args:
            camera: File of `softrobot robot camera`.
            size: Side [m] of the black square of the head's tags.
            device: Number of a camera, path or address of a film, or `package.module:name` or
                `file.py:name` of a function `Pictures` of your own.
            base_size: Of the base's tags; as `size` unless given.
            latency: [s] from the middle of the exposure until a picture arrives.
            **bodies: See `PoseTip`, by the tags' numbers; the tracker's own frame is the camera's,
                z along its view, y down. A tag's is x to its right, y up, z towards the reader.

        Raises:
            ValueError: A size or a number of a tag that is none, or as of `PoseTip`.
            ImportError: OpenCV is not installed.
            OSError: The camera or its file cannot be opened.
        """
        super().__init__(**bodies)
        check_argument("latency", latency, NotNegative)
        self._latency, self._camera = latency, read_camera(Path(camera))
        self._finder = TagFinder(self._camera)
        self._on_head = _body("size", size, self._head)
        self._at_base = _body("base_size", size if base_size is None else base_size, self._base)
        self._still: dict[int, list[tuple[ndarray, ndarray]]] = {}
        self._base_pose: ndarray | None = None
        self._pictures = _pictures(device)
        self._thread.start()

    def _next(self) -> TipMeasurement | None:
        time, image = self._pictures()
        if image.ndim == 3:
            image = self._finder._cv2.cvtColor(image, self._finder._cv2.COLOR_BGR2GRAY)
        if image.shape[::-1] != self._camera.size:
            raise LinkError(f"pictures have other sizes than the calibrated {self._camera}")
        return self.measure(time, image)

    def measure(self, time: float, image: ndarray) -> TipMeasurement | None:
        """What a picture says; None as long as the base is not known."""
        found = self._finder.find(image)
        if self._base:
            self._look_at_base(found, image)
            if self._base_pose is None:
                return None
        seen = [number for number in self._on_head.tags if number in found]
        if not seen:
            raise ValueError("no tag is seen")
        rays = {number: self._finder.refine(image, found[number]) for number in seen}
        head = self._finder.pose(self._on_head, rays)
        return self._seen(time, self._latency, head, self._base_pose)

    def _look_at_base(self, found: Mapping[int, ndarray], image: ndarray) -> None:
        """Average the base over the first pictures, and refuse later ones in which it has moved."""
        seen = {number: found[number] for number in self._at_base.tags if number in found}
        if self._base_pose is not None:
            for number, corners in seen.items():
                off = corners - self._corners.get(number, corners)
                if np.abs(off).mean() > _MOVED:
                    raise ValueError(f"tag {number} of the base, or the camera, has moved")
            return
        for number, corners in seen.items():
            both = corners, self._finder.refine(image, corners)
            self._still.setdefault(number, []).append(both)
        if max(map(len, self._still.values()), default=0) >= _BASE_IMAGES:
            kept = {n: each for n, each in self._still.items() if 2 * len(each) > _BASE_IMAGES}
            means = {n: np.mean(each, axis=0) for n, each in kept.items()}
            self._still.clear()
            self._corners = {number: corners for number, (corners, _) in means.items()}
            rays = {number: rays for number, (_, rays) in means.items()}
            self._base_pose = self._finder.pose(self._at_base, rays)

    def _free(self) -> None:
        self._pictures = None  # nobody else refers to it, and the camera is free


def _body(what: str, size: float, poses: Mapping[str, ndarray]) -> Body:
    check_argument(what, size, Positive)
    tags = {int(name) if name.isdecimal() else name: pose for name, pose in poses.items()}
    for number in tags:
        check_tag(number)
    return Body(size, tags)


def _pictures(device: int | str | Pictures) -> Pictures:
    if callable(device):
        return device
    if isinstance(device, str) and is_path(device) and "://" not in device:
        return load_given("camera", device)
    capture = opencv().VideoCapture(device)
    if not capture.isOpened():
        raise OSError(f"OpenCV cannot open the camera {device!r}")
    capture.set(opencv().CAP_PROP_BUFFERSIZE, 1)

    def take() -> tuple[float, ndarray]:
        there, time = capture.grab(), monotonic()
        there, image = capture.retrieve() if there else (False, None)
        if not there:
            raise LinkError("the camera gives no picture any more")
        return time, image

    return take
