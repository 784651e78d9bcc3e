"""An offscreen OpenGL context on machines with and without a display."""

import importlib
import os
import platform
import sys
import warnings
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

#: Backends in the order they are tried.
BACKENDS = ("egl", "osmesa", "glfw")

_OFF = ("disable", "disabled", "off", "false", "0")
_ANY = ("", "enable", "enabled", "on", "true", "1")
#: Pixels drawn for one of a picture along each side, which makes the edges of shadows smooth, and
#: the side up to which that is affordable.
_FINER, _LARGE = 2, 1000

_HELP = (
    "Install a software renderer (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri, or "
    "apt-get install libosmesa6) and the Python package PyOpenGL, or choose the backend with the "
    "environment variable MUJOCO_GL=egl|osmesa|glfw (glfw needs a display)"
)


class RenderError(RuntimeError):
    """No picture can be drawn on this machine; the message says what to install."""


def has_display() -> bool:
    """Whether a window can be expected to open."""
    if platform.system() != "Linux":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def check_display() -> None:
    """Start GLFW, which windows need.

    Raises:
        RenderError: There is no display, or it refuses windows.
    """
    if not has_display():
        raise RenderError("there is no display: neither DISPLAY nor WAYLAND_DISPLAY is set")
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GLFW tells the reason of a failure as a warning
        started = glfw.init()
    if not started:
        raise RenderError("the display cannot be opened: GLFW did not start")


def candidate_backends() -> tuple[str, ...]:
    """Backends to try: the one `MUJOCO_GL` names, else all that may work here.

    Raises:
        RenderError: `MUJOCO_GL` switches rendering off or names no backend.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower().strip()
    if asked in _OFF:
        raise RenderError(f"rendering is switched off by MUJOCO_GL={asked}")
    if platform.system() != "Linux":
        return ("native",)
    if asked in _ANY:
        return BACKENDS if has_display() else BACKENDS[:2]
    asked = {"glx": "glfw"}.get(asked, asked)
    if asked not in BACKENDS:
        raise RenderError(f"MUJOCO_GL={asked} is not one of {', '.join(BACKENDS)}")
    return (asked,)


class OffscreenContext:
    """A framebuffer outside any window."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        """Open the first backend that works.

        Args:
            model: What is drawn.
            width, height: Of pictures in pixels.

        Raises:
            RenderError: None does; the message says why, and what to install.
        """
        self._finer = _FINER if max(width, height) <= _LARGE else 1
        width, height = self._finer * width, self._finer * height
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._gl, self._buffers = _open_first(model, width, height)
        # Also runs when the interpreter exits, while the OpenGL modules still exist.
        self._finalizer = weakref.finalize(self, _free, self._gl, self._buffers)

    def draw(self, scene: mujoco.MjvScene) -> np.ndarray:
        """Picture (height, width, 3) uint8 of a scene."""
        self._gl.make_current()
        mujoco.mjr_render(self._rect, scene, self._buffers)
        pixels = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._buffers)
        pixels = pixels[::-1]  # OpenGL counts rows from below
        if self._finer == 1:
            return np.ascontiguousarray(pixels)
        height, width = self._rect.height // self._finer, self._rect.width // self._finer
        blocks = pixels.reshape(height, self._finer, width, self._finer, 3)
        total = np.sum(blocks, axis=(1, 3), dtype=np.uint16) + self._finer**2 // 2
        return (total // self._finer**2).astype(np.uint8)

    def close(self) -> None:
        """Free the framebuffer and the context."""
        self._finalizer()


def _free(gl: Any, buffers: mujoco.MjrContext) -> None:
    with gl.as_current():
        buffers.free()
    gl.free()


def _open_first(model: mujoco.MjModel, width: int, height: int) -> tuple[Any, mujoco.MjrContext]:
    reasons = []
    for backend in candidate_backends():
        loaded = set(sys.modules)
        platform_before = os.environ.get("PYOPENGL_PLATFORM")
        try:
            return _open(backend, model, width, height)
        except Exception as error:  # a missing or broken driver shows in any type
            reasons.append(f"{backend}: {error or type(error).__name__}")
        _forget_opengl(loaded, platform_before)
    raise RenderError(f"no OpenGL for offscreen pictures ({'; '.join(reasons)}). {_HELP}")


def _open(
    backend: str, model: mujoco.MjModel, width: int, height: int
) -> tuple[Any, mujoco.MjrContext]:
    if backend == "glfw":
        check_display()
    name = "mujoco.gl_context" if backend == "native" else f"mujoco.{backend}"
    gl = importlib.import_module(name).GLContext(width, height)
    gl.make_current()
    with _loader_of(backend):
        buffers = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, buffers)
    return gl, buffers


@contextmanager
def _loader_of(backend: str) -> Iterator[None]:
    """Tell MuJoCo, which reads the variable again here, whose OpenGL functions to load."""
    before = os.environ.get("MUJOCO_GL")
    if backend != "native":
        os.environ["MUJOCO_GL"] = backend
    try:
        yield
    finally:
        _restore("MUJOCO_GL", before)


def _forget_opengl(loaded: set[str], platform_before: str | None) -> None:
    """Undo the imports of a failed attempt: PyOpenGL fixes its platform when imported."""
    for name in set(sys.modules) - loaded:
        if name.split(".")[0] == "OpenGL" or name.removeprefix("mujoco.").split(".")[0] in BACKENDS:
            del sys.modules[name]
    _restore("PYOPENGL_PLATFORM", platform_before)


def _restore(variable: str, value: str | None) -> None:
    if value is None:
        os.environ.pop(variable, None)
    else:
        os.environ[variable] = value
