"""Numbers of a robot by which derivatives are wanted, and what a chain's numbers change by them."""

from collections.abc import Callable, Iterable
from dataclasses import fields, is_dataclass, replace
from functools import partial
from typing import Any, NamedTuple
from warnings import catch_warnings, simplefilter

import numpy as np
from mujoco import MjModel
from numpy import ndarray

from softrobot_env.robots import VARIATIONS, RobotParams
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.spec import build_chain
from softrobot_env.scene.timestep import TimestepWarning

from .model import flat, plan_of, values_of

#: Steps of differences over the scale of a parameter, and what is left of their error; scenes are
#: smooth functions of robots.
_STEP, _HALVINGS = 2e-2, 4


class Parameter(NamedTuple):
    """A number of a robot.

    Attributes:
        name: Of the derivative.
        apply: Function of the robot and a value that returns the robot with it.
        value: Where the robot is as it is.
        scale: By which the number might differ.
    """

    name: str
    apply: Callable[[RobotParams, float], RobotParams]
    value: float
    scale: float


def parameter(robot: RobotParams, name: str) -> Parameter:
    """A number by its name.

    That of a variation that scales, such as "youngs_modulus", or its place in the robot, such as
    "sections.0.length", "tendons.upper.offset.1", "tendons.0.friction" or "base.position.2".

    Raises:
        ValueError: There is no such number.
    """
    if name in VARIATIONS and VARIATIONS[name].apply is not None and VARIATIONS[name].is_factor:
        return Parameter(name, VARIATIONS[name].apply, 1.0, 1.0)
    path = name.split(".")
    value = robot
    for part in path:
        value = _within(value, part, name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise ValueError(f"{name!r} of robot {robot.name!r} is no number, it is {value!r}")
    scale = abs(value) or (1.0 if "gravity" in name else 1e-2 * robot.length)
    return Parameter(name, lambda robot, x: _with(robot, path, x, name), float(value), scale)


def _place(whole: Any, part: str, name: str) -> int | str:
    """The field or index that a part of a name stands for."""
    if is_dataclass(whole):
        names = [field.name for field in fields(whole)]
        if part in names:
            return part
    elif isinstance(whole, tuple):
        names = [getattr(x, "name", str(k)) for k, x in enumerate(whole)]
        if part in names:
            return names.index(part)
        if part.isdecimal() and int(part) < len(whole):
            return int(part)
    else:
        names = []
    raise ValueError(f"{name!r} is no number of a robot: {part!r} is none of {', '.join(names)}")


def _within(whole: Any, part: str, name: str) -> Any:
    place = _place(whole, part, name)
    return getattr(whole, place) if isinstance(place, str) else whole[place]


def _with(whole: Any, path: list[str], value: float, name: str) -> Any:
    """A robot, or a part of it, with another number at the end of a path."""
    if not path:
        return value
    place = _place(whole, path[0], name)
    part = _with(_within(whole, path[0], name), path[1:], value, name)
    if isinstance(place, str):
        return replace(whole, **{place: part})
    return (*whole[:place], part, *whole[place + 1 :])


def sensitivities(scene: Scene, wanted: Iterable[Parameter]) -> ndarray:
    """Derivatives (parameters, size) of a chain's numbers, as `flat` has them.

    Raises:
        ValueError: A parameter cannot differ a little to both sides, or not by smooth changes.
    """
    size = len(flat(values_of(scene.model)))
    rows = [derivative(one, partial(_numbers, scene, one)) for one in wanted]
    return np.array(rows).reshape(-1, size)


def derivative(one: Parameter, numbers: Callable[[float], ndarray]) -> ndarray:
    """Derivative (size,) of smooth numbers (size,) by a parameter, from their values at others.

    By extrapolated differences, which err by about 1e-11 of the numbers.
    """
    entries: list[ndarray] = []
    for k in range(_HALVINGS):
        step = _STEP * one.scale / 2**k
        above, below = (numbers(one.value + s * step) for s in (1, -1))
        entry = (above - below) / (2 * step)
        for j, before in enumerate(entries):
            weight = 1 / (4 ** (j + 1) - 1)
            entries[j], entry = entry, entry + weight * (entry - before)
        entries.append(entry)
    return entries[-1]


def varied_model(scene: Scene, one: Parameter, value: float) -> MjModel:
    """The model of a scene's robot with another value, and with the same timestep.

    Raises:
        ValueError: The robot cannot have it.
    """
    config, choice = scene.config, scene.timestep
    try:
        config = replace(config, robot=one.apply(config.robot, value))
        if choice.accuracy is not None:
            return build_chain(config).spec.compile()
        own = replace(config, integrator=choice.integrator, timestep=choice.timestep)
        with catch_warnings():
            simplefilter("ignore", TimestepWarning)
            return build_scene(own).model
    except ValueError as error:
        raise ValueError(f"no derivative by {one.name!r}: at {value:g} {error}") from error


def _numbers(scene: Scene, one: Parameter, value: float) -> ndarray:
    """The numbers (size,) of the chain of a robot with another value."""
    model = varied_model(scene, one, value)
    numbers, own, other = flat(values_of(model)), plan_of(scene.model), plan_of(model)
    alike = ((x.parents, x.parts, x.rubs, x.zones, x.bends) for x in (own, other))
    if not all(map(np.array_equal, *alike)) or not np.allclose(own.axis, other.axis):
        raise ValueError(f"no derivative by {one.name!r}: it changes what is joined to what")
    return numbers
