"""Tags and the camera's calibration, against the poses that pictures were drawn at."""

import re
import sys
import time
import tomllib
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

cv2 = pytest.importorskip("cv2")

from PIL import Image  # noqa: E402

from softrobot_env.cli import main  # noqa: E402
from softrobot_env.hardware import camera, tags  # noqa: E402
from softrobot_env.hardware.camera import Camera, read_camera, write_camera  # noqa: E402
from softrobot_env.hardware.errors import LinkError  # noqa: E402
from softrobot_env.hardware.tags import TagTip  # noqa: E402
from softrobot_env.hardware.tip import make_tip_source  # noqa: E402
from studies.truths.tag_images import FACING, Lens, picture, pose  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]

LENS = Lens()
KNOWN = Camera(LENS.size, LENS.focal, LENS.center, LENS.bend)
SIZE, BASE_SIZE = 0.04, 0.06
HEAD, BASE = 7, 300

#: The base stands beside the middle of the view, half a metre away and askew.
BASE_POSE = pose((-0.15, -0.02, 0.52), FACING * Rotation.from_rotvec([0.35, 0.2, 0.1]))


def cells(number):
    return camera.tag_sheet(number)[150:-90:60, 150:-90:60] > 127


def sheet(number, size, where):
    return cells(number), size / 8, where


def scene(head, rng, base=BASE_POSE, lens=LENS, more=()):
    """A picture of head and base, of which None is left out."""
    sheets = {"head": sheet(HEAD, SIZE, head)} if head is not None else {}
    if base is not None:
        sheets["base"] = sheet(BASE, BASE_SIZE, base)
    return picture(lens, sheets | dict(more), rng)


class Film:
    """Pictures one after another; the last one comes again for as long as it is asked for."""

    def __init__(self, *images):
        self.images, self.asked = list(images), 0

    def __call__(self):
        self.asked += 1
        time.sleep(0.002)
        image = self.images.pop(0) if len(self.images) > 1 else self.images[0]
        return time.monotonic(), image


@pytest.fixture
def known(tmp_path):
    write_camera(KNOWN, tmp_path / "camera.toml")
    return {"camera": str(tmp_path / "camera.toml"), "size": SIZE, "base_size": BASE_SIZE}


@pytest.fixture
def tip(known):
    """A source that measures pictures it is given; its own camera shows nothing."""
    options = {"head": {HEAD: [0, 0, -0.03]}, "base": {str(BASE): [0.05, 0, 0]}, "axes": "xyz"}
    nothing = Film(np.full(LENS.size[::-1], 128, np.uint8))
    with closing(TagTip(device=nothing, **options, **known)) as source:
        source.close()  # its thread
        source.refused = 0
        yield source


def settled(tip, rng):
    images = [scene(None, rng) for _ in range(4)]
    for image in images * (tags._BASE_IMAGES // 4):
        try:
            tip.measure(0.0, image)
        except ValueError as error:  # the base is known: only the head is missing
            assert "no tag" in str(error)
    assert tip._base_pose is not None


def moved(rng):
    """A pose of the head's tag, at half a metre, turned by up to 40 degrees."""
    turn = Rotation.from_rotvec(rng.uniform(-0.45, 0.45, 3))
    return pose((rng.uniform(-0.05, 0.2), rng.uniform(-0.1, 0.1), 0.5), FACING * turn)


def truth(head):
    """Pose of the tip in the robot's frame: 3 cm before its tag, 5 cm beside the base's."""
    tip, robot = np.eye(4), np.eye(4)
    tip[2, 3], robot[0, 3] = 0.03, 0.05
    return robot @ np.linalg.inv(BASE_POSE) @ head @ tip


def errors(found, wanted):
    """Distance [m] and angle [rad] between a measurement and a pose."""
    turn = Rotation.from_quat(found.orientation, scalar_first=True)
    angle = (turn.inv() * Rotation.from_matrix(wanted[:3, :3])).magnitude()
    return np.linalg.norm(found.position - wanted[:3, 3]), angle


@pytest.mark.slow
def test_the_tip_is_found_within_half_a_millimetre_and_a_degree(tip):
    rng = np.random.default_rng(5)
    settled(tip, rng)
    found = []
    for k in range(20):
        head = moved(rng)
        measured = tip.measure(float(k), scene(head, rng))
        assert measured.time == k
        found.append(errors(measured, truth(head)))
    far, turned = np.array(found).T
    assert far.max() < 0.5e-3 and turned.max() < np.radians(1.0)


def test_several_tags_of_a_head_count_together(known):
    """Three faces of a cube, of which any may be hidden."""
    rng = np.random.default_rng(6)
    faces = {1: [0, 0, 0.03], 2: [0.03, 0, 0, 0, np.pi / 2, 0], 3: [0, 0.03, 0, -np.pi / 2, 0, 0]}
    nothing = Film(np.zeros(LENS.size[::-1], np.uint8))
    source = TagTip(device=nothing, head=faces, axes="xyz", **known)
    source.close()
    cube = pose((0.02, 0.01, 0.5), FACING * Rotation.from_euler("xyz", [0.6, -0.5, 0.2]))
    sheets = {}
    for number, where in faces.items():
        own = pose(where[:3], Rotation.from_rotvec([*where, 0, 0, 0][3:6]))
        sheets[number] = sheet(number, SIZE, cube @ own)
    for shown in ([1, 2, 3], [1, 2], [2, 3]):
        image = picture(LENS, {number: sheets[number] for number in shown}, rng)
        far, turned = errors(source.measure(0.0, image), cube)
        assert far < 0.3e-3 and turned < np.radians(0.3)


def test_pictures_that_say_nothing_are_refused(tip):
    rng = np.random.default_rng(7)
    settled(tip, rng)
    head = moved(rng)
    twice = [("other", sheet(HEAD, SIZE, pose((0.1, 0.12, 0.6), FACING)))]
    beside = pose((-0.148, -0.02, 0.52), FACING * Rotation.from_rotvec([0.35, 0.2, 0.1]))
    small = pose((0.1, 0.0, 2.0), FACING * Rotation.from_rotvec([0.2, 0, 0]))
    for image, why in (
        (scene(None, rng), "no tag is seen"),
        (scene(head, rng, more=twice), "no tag is seen"),
        (scene(head, rng, base=beside @ pose((0.01, 0, 0), Rotation.identity())), "has moved"),
        (scene(small, rng), "no tag is seen"),
        (np.zeros(LENS.size[::-1], np.uint8), "no tag is seen"),
        (rng.integers(0, 256, LENS.size[::-1], np.uint8), "no tag is seen"),
    ):
        with pytest.raises(ValueError, match=why):
            tip.measure(0.0, image)


def test_a_tag_that_may_be_turned_either_way_is_not_guessed():
    """Exact rays: far away, both turns look the same to a tenth of a pixel; near, they do not."""
    finder, body = tags.TagFinder(KNOWN), tags.Body(SIZE, {HEAD: np.eye(4)})
    turn = FACING * Rotation.from_rotvec([0.2, 0.1, 0])
    for distance, told in ((0.5, True), (3.0, False)):
        points = body.corners(HEAD) @ turn.as_matrix().T + [0.05, 0.02, distance]
        rays = {HEAD: points[:, :2] / points[:, 2:]}
        if told:
            found = finder.pose(body, rays)
            assert found == pytest.approx(pose((0.05, 0.02, distance), turn), abs=1e-6)
        else:
            with pytest.raises(ValueError, match="two poses fit"):
                finder.pose(body, rays)


def test_tags_of_another_size_than_said_do_not_fit(known):
    """Two tags at the places of smaller ones."""
    rng = np.random.default_rng(8)
    head = {1: [0, 0, 0], 2: [0.05, 0, 0]}
    nothing = Film(np.zeros(LENS.size[::-1], np.uint8))
    source = TagTip(device=nothing, head=head, **known)
    source.close()
    where = moved(rng)
    beside = where @ pose((0.06, 0, 0), Rotation.identity())
    shown = {"1": sheet(1, SIZE, where), "2": sheet(2, SIZE, beside)}
    with pytest.raises(ValueError, match="no pose fits"):
        source.measure(0.0, picture(LENS, shown, rng))


def test_a_picture_without_a_tag_leaves_the_measurement_old(known):
    rng = np.random.default_rng(9)
    film = Film(scene(moved(rng), rng), scene(None, rng, base=None))
    options = {"head": {HEAD: [0, 0, 0]}, "latency": 0.05, "device": film}
    begin = time.monotonic()
    with closing(make_tip_source("tags", options | known)) as source:
        while source.refused < 3:
            assert time.monotonic() < begin + 20
            time.sleep(0.01)
        assert source.latest(None, 0.0).time < time.monotonic() - 0.05
        assert source.latest(None, 0.0).time > begin - 0.05
        first = source.latest(None, 0.0)
        film.images.append(np.zeros((3, 3), np.uint8))
        while source._failure is None:
            assert time.monotonic() < begin + 20
            time.sleep(0.01)
        with pytest.raises(LinkError, match="other sizes than the calibrated"):
            source.latest(None, 0.0)
        assert first.position.shape == (2,)


def test_a_film_ends_and_a_camera_that_is_not_there_is_refused(known, tmp_path):
    rng = np.random.default_rng(10)
    path = str(tmp_path / "film.avi")
    how = cv2.VideoWriter_fourcc(*"MJPG")
    film = cv2.VideoWriter(path, how, 30.0, LENS.size)
    assert film.isOpened()
    head = moved(rng)
    for _ in range(3):
        film.write(cv2.cvtColor(scene(head, rng, base=None), cv2.COLOR_GRAY2BGR))
    film.release()
    with closing(TagTip(head={HEAD: [0, 0, 0]}, device=path, axes="xyz", **known)) as source:
        end = time.monotonic() + 20
        while source._failure is None:
            assert time.monotonic() < end
            time.sleep(0.01)
        assert errors(source._sight, head)[0] < 1e-3  # compressed
        with pytest.raises(LinkError, match="gives no picture any more"):
            source.latest(None, 0.0)
    with pytest.raises(OSError, match="cannot open the camera"):
        TagTip(head={HEAD: [0, 0, 0]}, device=str(tmp_path / "none.avi"), **known)


@pytest.mark.parametrize(
    "options, allowed",
    [
        ({"size": 0.0}, "size must be finite and positive"),
        ({"base_size": -1.0}, "base_size must be finite and positive"),
        ({"latency": -1.0}, "latency must be finite and zero or more"),
        ({"head": {"tip": [0, 0, 0]}}, "tags have numbers from 0 to 586"),
        ({"head": {587: [0, 0, 0]}}, "tags have numbers from 0 to 586"),
        ({"device": "nowhere.py:camera"}, "the camera 'nowhere.py:camera'"),
    ],
)
def test_bad_options_are_refused(known, options, allowed):
    options = {"head": {1: [0, 0, 0]}, "base": {2: [0, 0, 0]}, **known, **options}
    with pytest.raises(ValueError, match=allowed):
        make_tip_source("tags", options)


def board_at(where, square=0.03):
    """The board's cells at a 120th of a square, and its pose."""
    return camera.board_sheet()[1::3, 1::3] > 127, square / 120, where


def views(rng, count, lens):
    for _ in range(count):
        turn = FACING * Rotation.from_rotvec(rng.uniform(-0.6, 0.6, 3))
        place = (rng.uniform(-0.15, 0.15), rng.uniform(-0.1, 0.1), rng.uniform(0.4, 0.5))
        yield picture(lens, {"board": board_at(pose(place, turn))}, rng, count=9)


@pytest.mark.slow
def test_calibration_finds_the_lens(tmp_path, capsys):
    lens = Lens((800, 600), (720.0, 722.0), (402.0, 296.0), (-0.12, 0.05, 8e-4, -6e-4, 0.0))
    rng = np.random.default_rng(11)
    paths = []
    for k, image in enumerate([*views(rng, 14, lens), np.zeros((600, 800), np.uint8)]):
        paths.append(tmp_path / f"{k}.png")
        cv2.imwrite(str(paths[-1]), image)
    out = tmp_path / "camera.toml"
    assert main(["robot", "camera", *map(str, paths), "--side", "0.03", "--out", str(out)]) == 1
    said = "".join(capsys.readouterr().out.split())  # lines end where the terminal does
    assert f"{paths[-1]}doesnotshow" in said
    found = read_camera(out)
    assert found.size == lens.size
    assert found.focal == pytest.approx(lens.focal, rel=3e-3)
    assert np.abs(np.subtract(found.focal, lens.focal)).max() < 4 * found.uncertainty
    assert found.center == pytest.approx(lens.center, abs=2.0)
    # What counts: rays of the whole picture.
    pixels = np.stack(np.meshgrid(np.linspace(40, 760, 9), np.linspace(40, 560, 7)), -1)
    pixels = pixels.reshape(-1, 2)
    rays = cv2.undistortPoints(pixels[:, None], found.matrix, np.array(found.distortion))[:, 0]
    assert np.abs(rays - lens.rays(pixels)[:, :2]).max() < 2e-3
    with pytest.raises(ValueError, match=r"7 pictures show .* 8 are needed"):
        camera.calibrated(paths[:7], 0.03)
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((6, 8), np.uint8))
    with pytest.raises(ValueError, match="has \\(8, 6\\) pixels, others have \\(800, 600\\)"):
        camera.calibrated([paths[0], tmp_path / "small.png"], 0.03)
    (tmp_path / "text.png").write_text("no picture")
    with pytest.raises(ValueError, match="no picture that OpenCV reads"):
        camera.calibrated([tmp_path / "text.png"], 0.03)


@pytest.mark.parametrize("suffix", [".png", ".pdf"])
def test_a_printed_tag_has_the_size_that_was_asked_for(suffix, tmp_path):
    out = tmp_path / f"tag{suffix}"
    assert main(["robot", "camera", "--tag", "7", "--side", "0.04", "--out", str(out)]) == 0
    if suffix == ".pdf":
        found = re.search(rb"/MediaBox \[ ?0 0 ([0-9.]+) ([0-9.]+)", out.read_bytes())
        inches = [float(side) / 72 for side in found.groups()]
        assert inches == pytest.approx([0.07 / 0.0254] * 2, rel=1e-3)  # 12 cells and a margin
        return
    image = Image.open(out)
    corners, numbers, _ = cv2.aruco.ArucoDetector(camera.tag_dictionary()).detectMarkers(
        np.array(image)
    )
    assert numbers.ravel().tolist() == [7]
    side = np.linalg.norm(corners[0][0][1] - corners[0][0][0]) / image.info["dpi"][0] * 0.0254
    assert side == pytest.approx(0.04, rel=5e-3)


def test_what_is_missing_is_named(known, monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ImportError, match="tag cameras need OpenCV: pip install"):
        make_tip_source("tags", {"head": {1: [0, 0, 0]}, **known})
    assert main(["robot", "camera", "--out", str(tmp_path / "board.png")]) == 2
    assert "pip install" in capsys.readouterr().err and not list(tmp_path.glob("board*"))
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needs = extras["optional-dependencies"]["camera"]
    assert any(each.startswith("opencv-python-headless>") for each in needs)
