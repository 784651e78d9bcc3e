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
_STEPS = np.linspace(-3.0, 3.0, 13)  # pixels across it
_NARROWEST = 8 * 5.0  # pixels, of a tag: beside its edges are cells of an eighth of it

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

    def refine(self, image: ndarray, found: Mapping[int, ndarray]) -> dict[int, ndarray]:
        """Rays (4, 2), of depth 1, to corners of tags: where lines along their edges cross.

        An edge is at the mean of where the picture gets brighter outwards, at places along a side,
        which does not depend on how soft it is or how it lies on the pixels. Corners as OpenCV
        refines them are off by a quarter of a pixel where pictures are soft. Tags that are too
        small for it, or seen too much from aside, are left out.
        """
        rays = {}
        for number, corners in found.items():
            first, second = corners[2] - corners[0], corners[3] - corners[1]  # diagonals
            longest = np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1).max()
            width = abs(first[0] * second[1] - first[1] * second[0]) / 2 / longest
            if width >= _NARROWEST:
                edges = self._edges(image, corners).reshape(-1, 1, 2)
                straight = self._cv2.undistortPoints(edges, self._matrix, self._bend)
                rays[number] = _crossings(straight.reshape(4, -1, 2))
        return rays

    def _edges(self, image: ndarray, corners: ndarray) -> ndarray:
        """Points (4, samples, 2) [pixels] of a tag's edges."""
        side = np.roll(corners, -1, 0) - corners
        outwards = np.stack([side[:, 1], -side[:, 0]], 1)
        outwards = (outwards / np.linalg.norm(side, axis=1, keepdims=True))[:, None]
        places = corners[:, None] + _SAMPLES[:, None] * side[:, None]
        across = places[:, :, None] + _STEPS[:, None] * outwards[:, None]
        across = across.reshape(-1, len(_STEPS), 2).astype(np.float32)
        grey = self._cv2.remap(image, across, None, self._cv2.INTER_LINEAR).astype(float)
        brighter = np.diff(grey, axis=1)
        moment = brighter @ (_STEPS[1:] + _STEPS[:-1]) / 2
        shift = np.clip(moment / np.maximum(brighter.sum(1), 1e-9), _STEPS[0], _STEPS[-1])
        return places + shift.reshape(4, -1, 1) * outwards

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


def _crossings(edges: ndarray) -> ndarray:
    """Corners (4, 2) where lines through points (4, samples, 2) cross."""
    middle = edges.mean(1)
    normal = np.linalg.svd(edges - middle[:, None])[2][:, 1]
    lines = np.column_stack([normal, -np.sum(normal * middle, axis=1)])
    corners = np.cross(np.roll(lines, 1, 0), lines)
    return corners[:, :2] / corners[:, 2:]


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
        rays = self._finder.refine(image, {n: found[n] for n in self._on_head.tags if n in found})
        if not rays:
            raise ValueError("no tag is seen")
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
        for number, rays in self._finder.refine(image, seen).items():
            self._still.setdefault(number, []).append((seen[number], rays))
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
