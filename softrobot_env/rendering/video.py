"""Videos of episodes: frames with a caption, written as mp4 or gif."""

from collections.abc import Callable, Iterable, Iterator
from itertools import chain, count
from math import floor
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy import ndarray

from softrobot_env.core.extras import needed
from softrobot_env.core.files import atomic_write
from softrobot_env.core.interfaces import Policy
from softrobot_env.evaluation.run import play
from softrobot_env.scene.appearance import tension_colours

#: File name suffixes a video can have.
SUFFIXES = (".mp4", ".gif")

_INK = (35, 38, 46)
_PAPER = (255, 255, 255)


def write_video(path: str | Path, frames: Iterable[ndarray], fps: float) -> int:
    """Write frames to a video file.

    Args:
        path: Ends in one of `SUFFIXES`; folders are made as needed. An mp4 is H.264 in yuv420p,
            which every player reads; its width and height are rounded down to even numbers.
        frames: Arrays (height, width, 3) uint8 of one size, used one at a time.
        fps: Frames per second. A gif stores hundredths of seconds between frames.

    Returns:
        Number of frames written.

    Raises:
        ValueError: Another suffix, no frame, or fps not positive.
        ImportError: Pillow is not installed, or imageio for an mp4.
    """
    path = Path(path)
    suffix = check_suffix(path)
    if not fps > 0:
        raise ValueError(f"fps must be positive, got {fps!r}")
    write = _write_gif if suffix == ".gif" else _write_mp4
    iterator = iter(frames)
    first = next(iterator, None)
    if first is None:
        raise ValueError(f"there are no frames to write to {path.name!r}")
    with atomic_write(path) as aside:
        aside.touch()  # a folder that takes no file is refused before the writer, which tells twice
        return write(aside, chain([first], iterator), fps)


def _write_gif(path: Path, frames: Iterator[ndarray], fps: float) -> int:
    """Write a gif that repeats for ever; the number of its frames."""
    with needed("a gif needs pillow", "viz"):
        from PIL import Image
    number = count()
    images = (Image.fromarray(frame) for frame, _ in zip(frames, number, strict=False))
    timing = {"duration": 1000 / fps, "loop": 0}
    next(images).save(path, "GIF", save_all=True, append_images=images, **timing)
    return next(number)


def _write_mp4(path: Path, frames: Iterator[ndarray], fps: float) -> int:
    """Write an mp4; the number of its frames."""
    with needed("an mp4 needs imageio[ffmpeg]", "viz"):
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401
    options = {"codec": "libx264", "pixelformat": "yuv420p", "quality": 8, "macro_block_size": 1}
    number = 0
    with imageio.get_writer(path, fps=fps, ffmpeg_log_level="error", **options) as writer:
        for frame in frames:
            height, width = frame.shape[:2]  # without an odd row or column: chroma has half of them
            writer.append_data(frame[: height - height % 2, : width - width % 2])
            number += 1
    return number


def check_suffix(path: Path) -> str:
    """The suffix of a video file; ValueError if it is no video's."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"a video file must end in {' or '.join(SUFFIXES)}, got {path.name!r}")
    return suffix


def caption(frame: ndarray, lines: Iterable[str]) -> ndarray:
    """Copy of a frame (height, width, 3) uint8 with lines of text in its upper left corner.

    Raises:
        ImportError: Pillow is not installed.
    """
    size = max(10, frame.shape[0] // 28)
    return _write(frame, (size, size), "\n".join(lines), spacing=6)


def _write(frame: ndarray, at: tuple[float, float], text: str, **options: Any) -> ndarray:
    """Copy of a frame with text at a place (x, y) in pixels."""
    with needed("videos need pillow", "viz"):
        from PIL import Image, ImageDraw, ImageFont
    image = Image.fromarray(frame)
    font = ImageFont.load_default(max(10, frame.shape[0] // 28))
    ImageDraw.Draw(image).text(at, text, _INK, font, stroke_width=2, stroke_fill=_PAPER, **options)
    return np.asarray(image)


def explain(frame: ndarray, metres_per_pixel: float, limit: float) -> ndarray:
    """Copy of a frame (height, width, 3) uint8 with a length scale and the colours of tensions.

    Args:
        frame: The picture.
        metres_per_pixel: [m].
        limit: [N], the tension of the strongest colour.

    Raises:
        ImportError: Pillow is not installed.
    """
    height, width = frame.shape[:2]
    size = max(10, height // 28)
    room = 0.25 * width * metres_per_pixel
    length = next(
        (x for k in range(3, -5, -1) for x in (5 * 10.0**k, 2 * 10.0**k, 10.0**k) if x <= room),
        room,
    )
    out = frame.copy()
    bottom = height - size
    wide = round(length / metres_per_pixel)
    out[bottom - 2 : bottom, size : size + wide] = _INK
    bar = width // 5
    left = width - size - bar
    colours = tension_colours(np.linspace(0, 1, bar))[:, :3]
    out[bottom - size // 2 : bottom, left : left + bar] = np.uint8(255 * colours)
    out = _write(out, (size, bottom - 2 - 1.6 * size), f"{1e3 * length:g} mm")
    text = f"tension, 0 to {limit:.3g} N"
    return _write(out, (width - size, bottom - 2.2 * size), text, anchor="ra")


def record(
    env: gymnasium.Env,
    policy: Policy,
    fps: float = 30.0,
    *,
    title: str | None = None,
    begin: float = 0.0,
    options: dict[str, Any] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Iterator[ndarray]:
    """Run one episode and yield captioned frames.

    Args:
        env: Environment with render mode "rgb_array".
        policy: A policy; it sees only the observables it `requires`, if it says so.
        fps: Frames per second of simulated time; the environment draws no others.
        title: First line of the caption; the task's label unless given.
        begin: [s], time of the first frame; what is before is not drawn.
        options: Passed to `reset`.
        progress: Called after every step with the share of the episode done, in [0, 1].

    Yields:
        Frames (height, width, 3) uint8: one at `begin`, then one every 1 / fps. Where the
        control period is longer than that, frames repeat. A failure adds a frame that names it.

    Raises:
        ValueError: The environment does not render arrays, or fps is not positive.
    """
    if env.render_mode != "rgb_array" or not fps > 0:
        raise ValueError(
            'record needs an environment with render_mode="rgb_array" and a positive fps, got '
            f"render_mode={env.render_mode!r} and fps={fps!r}"
        )
    task = env.unwrapped.task
    limit = max(t.tension_limit for t in task.robot.tendons)
    duration = (options or {}).get("duration", task.duration)

    def frames() -> Iterator[ndarray]:
        written = 0
        for moment in play(env, policy, options=options):
            info = moment.info
            due = floor((info["time"] - begin) * fps + 1e-6) + 1
            if due > written or moment.failed:
                picture, scale = env.render(), env.unwrapped.metres_per_pixel
                picture = picture if scale is None else explain(picture, scale, limit)
                error = f"t = {info['time']:.2f} s   error = {1e3 * info['error']:.1f} mm"
                failure = [info["failure"]] if "failure" in info else []
                picture = caption(picture, [title or task.label, error, *failure])
                yield from [picture] * max(1, due - written)
                written = max(due, written)
            if progress is not None:
                progress(min(1.0, info["time"] / duration))

    return frames()
