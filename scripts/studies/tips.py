"""Where a tracker says that the tip is: error and latency of every source, against the truth.

Pictures of tags are drawn from known poses, packets are put together from the public description of
NatNet; see `truths.tag_images` and `truths.natnet_packets`. Everything runs on one core.
"""

import json
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from softrobot_env.hardware import camera
from softrobot_env.hardware.camera import Camera
from softrobot_env.hardware.natnet import NatNetTip
from softrobot_env.hardware.tags import TagTip
from softrobot_env.hardware.tip import TipMeasurement, TipSource, UdpTip
from studies.lab import Record, Study, quantity, table
from studies.truths.natnet_packets import Motive
from studies.truths.tag_images import FACING, Lens, picture, pose

#: Measurements of a run and of a quick one.
COUNT, QUICK_COUNT = 60, 12

#: m, sides of the black squares of the tags on the head and at the base.
SIZE, BASE_SIZE = 0.04, 0.06

#: Tags at distances [m] of the camera, of which one case calibrates the camera first, with so many
#: pictures of the board; and trackers that send packets.
TAGS = {"one tag": 0.5, "one tag, calibrated": 0.5, "cube": 0.5, "one tag, far": 1.0}
VIEWS = 20
PACKETS = ("udp", "natnet 3.0", "natnet 4.1")

QUICK = ("one tag", *PACKETS)

LENS = Lens()
_WAIT = 5.0  # s
_AGE = 0.004  # s, of what packets say


@dataclass(frozen=True)
class Row(Record):
    """A source.

    Attributes:
        source: Kind, and for NatNet the version of its packets.
        case: Of `TAGS`; empty for others.
        count: Measurements.
        refused: Pictures or packets among them that were refused.
        e_mean, e_max: [m] between position and truth.
        turn_max: [rad] between orientation and truth; None where the source has none.
        latency, latency_max: [s] from a picture in memory, or the sending of a packet, until the
            measurement is there; median and largest.
        stamp: Largest error [s] of the time that the measurement says.
        cpu: [s] of the processor for a picture, the median; None of packets.
    """

    source: str
    case: str
    count: int
    refused: int
    e_mean: float = quantity("mm", ".2g", "error, mean")
    e_max: float = quantity("mm", ".2g", "error, max")
    turn_max: float | None = quantity("mrad", ".2g", "turn, max", default=None)
    latency: float = quantity("ms", ".2g", "latency", default=0.0)
    latency_max: float = quantity("ms", ".2g", "latency, max", default=0.0)
    stamp: float = quantity("ms", ".2g", "time stamp, max", default=0.0)
    cpu: float | None = quantity("ms", ".2g", "CPU", default=None)


#: When something was really so [s], its pose (4, 4) in the robot's frame, and when it was sent [s].
Truth = tuple[float, ndarray, float]


def cases(quick: bool) -> Iterator[tuple[str, int]]:
    """Cases and their numbers of measurements."""
    for name in QUICK if quick else (*TAGS, *PACKETS):
        yield name, QUICK_COUNT if quick else COUNT


def measure(case: tuple[str, int]) -> list[Row]:
    """Compare a source with the truth."""
    name, count = case
    rng = np.random.default_rng([count, *name.encode()])
    if name in TAGS:
        return [_tags(name, count, rng)]
    return [_udp(count, rng) if name == "udp" else _natnet(name, count, rng)]


def _row(source: TipSource, names: tuple[str, str], count: int, show: Callable[[], Truth]) -> Row:
    """Show poses one after another, and wait for what the source makes of each."""
    far, turned, waited, stamps = [], [], [], []
    for _ in range(count):
        before, refused = source.latest(None, 0.0), source.refused
        true_time, true, sent = show()
        found = _next(source, before, refused)
        if found is None:
            continue
        waited.append(time.monotonic() - sent)
        stamps.append(abs(found.time - true_time))
        far.append(float(np.linalg.norm(found.position - true[:3, 3])))
        if found.orientation is not None:
            turn = Rotation.from_quat(found.orientation, scalar_first=True)
            between = turn.inv() * Rotation.from_matrix(true[:3, :3])
            turned.append(float(between.magnitude()))
    return Row(
        *names,
        count,
        count - len(far),
        e_mean=float(np.mean(far)),
        e_max=max(far),
        turn_max=max(turned, default=None),
        latency=median(waited),
        latency_max=max(waited),
        stamp=max(stamps),
    )


def _next(source: TipSource, before: TipMeasurement | None, refused: int) -> TipMeasurement | None:
    """The measurement after another one; None if it is refused."""
    end = time.monotonic() + _WAIT
    while time.monotonic() < end:
        found = source.latest(None, 0.0)
        if found is not before:
            return found
        if source.refused != refused:
            return None
        time.sleep(1e-4)
    raise RuntimeError("a source says nothing")


# ---------------------------------------------------------------- tags

_BASE_POSE = pose((-0.15, -0.02, 0.52), FACING * Rotation.from_rotvec([0.35, 0.2, 0.1]))
_HEAD = {7: [0.0, 0.0, -0.03]}
_CUBE = {
    1: [0.0, 0.0, 0.03],
    2: [0.03, 0.0, 0.0, 0.0, np.pi / 2, 0.0],
    3: [0.0, 0.03, 0.0, -np.pi / 2, 0.0, 0.0],
}
_BASE = {300: [0.0, 0.0, 0.0]}


class _Stage:
    """A camera that takes a picture when it is told to."""

    def __init__(self) -> None:
        self.taken: list[tuple[float, ndarray]] = []
        self.asked = 0
        self.spent: list[float] = []
        self._began: float | None = None

    def __call__(self) -> tuple[float, ndarray]:
        self.asked += 1
        if self._began is not None:
            self.spent.append(time.thread_time() - self._began)
            self._began = None
        end = time.monotonic() + 0.1
        while time.monotonic() < end:
            if self.taken:
                self._began = time.thread_time()
                return self.taken.pop()
            time.sleep(1e-4)
        raise TimeoutError


def _tags(name: str, count: int, rng: np.random.Generator) -> Row:
    known = Camera(LENS.size, LENS.focal, LENS.center, LENS.bend)
    with TemporaryDirectory() as folder:
        if name.endswith("calibrated"):
            known, _ = camera.calibrated(_views(Path(folder), rng), 0.03)
        path = Path(folder) / "camera.toml"
        camera.write_camera(known, path)
        head, stage = _CUBE if name == "cube" else _HEAD, _Stage()
        source = TagTip(str(path), SIZE, stage, BASE_SIZE, head=head, base=_BASE, axes="xyz")
    with closing(source):
        _show_base(source, stage, rng)

        def show() -> Truth:
            tip, image = _picture(head, TAGS[name], rng)
            now = time.monotonic()
            stage.taken.append((now, image))
            return now, np.linalg.inv(_BASE_POSE) @ tip, now

        stage.spent.clear()
        row = _row(source, ("tags", name), count, show)
        return replace(row, cpu=median(stage.spent))


def _cells(number: int) -> ndarray:
    """Cells of a tag without its margin, True where white."""
    return camera.tag_sheet(number)[150:-90:60, 150:-90:60] > 127


def _show_base(source: TagTip, stage: _Stage, rng: np.random.Generator) -> None:
    """Show the base alone, until it is known: then there is no head to be seen."""
    sheets = {"base": (_cells(300), BASE_SIZE / 8, _BASE_POSE)}
    images = [picture(LENS, sheets, rng) for _ in range(10)]
    while not source.refused:
        if not stage.taken:
            stage.taken.append((time.monotonic(), images[rng.integers(len(images))]))
        time.sleep(1e-3)
    stage.taken.clear()
    asked = stage.asked
    while stage.asked == asked:  # it still looks at the last one
        time.sleep(1e-3)


def _picture(
    head: dict[int, list[float]], distance: float, rng: np.random.Generator
) -> tuple[ndarray, ndarray]:
    """Pose (4, 4) of a tip in the camera's frame, and a picture of it and of the base."""
    turn = Rotation.from_rotvec(rng.uniform(-0.45, 0.45, 3))
    if len(head) > 1:  # a corner of the cube looks at the camera
        turn = Rotation.from_euler("xyz", [0.6, -0.6, 0.0]) * turn
    place = (rng.uniform(-0.02, 0.2), rng.uniform(-0.1, 0.1), distance)
    tip = pose(place, FACING * turn)
    sheets = {"base": (_cells(300), BASE_SIZE / 8, _BASE_POSE)}
    for number, where in head.items():
        own = tip @ pose(where[:3], Rotation.from_rotvec([*where, 0.0, 0.0, 0.0][3:6]))
        if own[:3, 2] @ own[:3, 3] < 0:  # others are turned away
            sheets[number] = _cells(number), SIZE / 8, own
    return tip, picture(LENS, sheets, rng)


def _views(folder: Path, rng: np.random.Generator) -> list[Path]:
    """Pictures of the board."""
    cells, paths = camera.board_sheet()[1::3, 1::3] > 127, []
    for k in range(VIEWS):
        turn = FACING * Rotation.from_rotvec(rng.uniform(-0.6, 0.6, 3))
        place = (rng.uniform(-0.15, 0.15), rng.uniform(-0.1, 0.1), rng.uniform(0.35, 0.5))
        image = picture(LENS, {"board": (cells, 0.03 / 120, pose(place, turn))}, rng, count=9)
        paths.append(folder / f"{k}.png")
        camera.opencv().imwrite(str(paths[-1]), image)
    return paths


# ---------------------------------------------------------------- packets


def _natnet(name: str, count: int, rng: np.random.Generator) -> Row:
    major, minor = name.split()[1].split(".")
    server = Motive((int(major), int(minor)), {"tip": 12})
    source = NatNetTip(
        multicast="", host="127.0.0.1", port=server.port, head={"tip": [0, 0, 0]}, axes="xyz"
    )
    with closing(server), closing(source):
        end = time.monotonic() + _WAIT
        while not source.ready and time.monotonic() < end:
            time.sleep(1e-3)

        def show() -> Truth:
            turn = Rotation.random(rng=rng)
            place = tuple(rng.uniform(-1, 1, 3).tolist())
            now = time.monotonic()
            server.show([(12, place, tuple(turn.as_quat().tolist()), True)], _AGE)
            return now - _AGE, pose(place, turn), now

        return _row(source, (name, ""), count, show)


def _udp(count: int, rng: np.random.Generator) -> Row:
    with closing(UdpTip(0, axes="xyz")) as source:
        sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

        def show() -> Truth:
            turn, place = Rotation.random(rng=rng), rng.uniform(-1, 1, 3)
            message = dict(zip("xyz", place.tolist(), strict=True)) | {"age": _AGE}
            message["q"] = turn.as_quat(scalar_first=True).tolist()
            now = time.monotonic()
            sender.sendto(json.dumps(message).encode(), ("127.0.0.1", source.port))
            return now - _AGE, pose(tuple(place), turn), now

        with closing(sender):
            return _row(source, ("udp", ""), count, show)


STUDY = Study(
    kinds=(Row,),
    cases=cases,
    measure=measure,
    label=lambda case: case[0],
    tables=[
        table(f"{title}, by source", "source", "case", *columns)
        for title, columns in {
            "Error of the tip": ("count", "refused", "e_mean", "e_max", "turn_max"),
            "Latency of the tip": ("latency", "latency_max", "stamp", "cpu"),
        }.items()
    ],
    note=f"tags: {1e3 * SIZE:g} mm, at 0.5 m or 1 m (far), of a camera with {LENS.size[0]} x "
    f"{LENS.size[1]} pixels and {LENS.focal[0]:g} pixels focal length, positions in the frame of a "
    f"base tag of {1e3 * BASE_SIZE:g} mm; calibrated: by {VIEWS} pictures of the printed board, "
    "otherwise the lens is known. latency: from a picture in memory, or from the sending of a "
    "packet, until the measurement can be asked for.",
    alone=True,
)
