"""Parameters of a robot, its drives and its sensors that can vary between episodes.

One entry of `VARIATIONS` defines a varied parameter: `RobotParams.vary`, the option `vary`
of environments, `Randomization`, `softrobot evaluate --vary` and the labels of reports read it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from numbers import Real
from typing import Any

from softrobot_env.core.records import Vector2, check_fields
from softrobot_env.core.registry import Registry

#: Smallest and largest factors [1], and amounts that may be zero.
FACTORS, AMOUNTS = (1e-6, 1e6), (0.0, 1e6)


@dataclass(frozen=True)
class Variation:
    """A number that can differ from the nominal robot's.

    Attributes:
        name: In `vary`, `Randomization`, `--vary` and, after "variation_", in `info`.
        apply: Function of a robot (`RobotParams`) and a value that returns the varied robot; None
            for drives and sensors, which environments handle themselves.
        neutral: Value that leaves everything unchanged.
        range: Smallest and largest value.
        unit: In SI, "1" for factors.
        label: Text for a value in reports.
        scales: Fields of a MuJoCo model that are proportional to the value, if that is all that
            changes. Many simulations then vary at once; else a scene is built for each.
        shifts: Fields that depend linearly on it, under the same condition.
        switches: Fields that change as soon as it is not neutral, under the same condition.
        at_once: Function of a robot that says whether these fields are all that changes; of any
            robot unless given.
        incompatibility: Function of a robot that says why it cannot have other values, or returns
            None.
    """

    name: str
    apply: Callable[[Any, float], Any] | None = None
    neutral: float = 1.0
    range: Vector2 = FACTORS
    unit: str = "1"
    label: Callable[[float], str] | None = None
    scales: tuple[str, ...] = ()
    shifts: tuple[str, ...] = ()
    switches: tuple[str, ...] = ()
    at_once: Callable[[Any], bool] | None = None
    incompatibility: Callable[[Any], str | None] | None = None

    def __post_init__(self) -> None:
        check_fields(self, f"variation {self.name!r}")
        if not self.range[0] <= self.neutral <= self.range[1]:
            raise ValueError(f"variation {self.name!r}: neutral must lie in its range")

    @property
    def is_factor(self) -> bool:
        """Whether values are factors, which are sampled log-uniformly."""
        return self.neutral == 1

    def is_of_fields(self, robot: Any) -> bool:
        """Whether fields of a model say all that it changes of a robot."""
        known = bool(self.scales or self.shifts or self.switches)
        return known and (self.at_once is None or self.at_once(robot))

    def check(self, value: object) -> float:
        """A value as a number; raises ValueError if it is none, or out of range."""
        number = as_number(value)
        low, high = self.range
        if number is None or not low <= number <= high:
            unit = "" if self.unit == "1" else f" {self.unit}"
            raise ValueError(
                f"value of {self.name!r} must be a number from {low:g} to {high:g}{unit}, got "
                f"{value!r}"
            )
        return number

    def shown(self, value: float) -> str:
        """A value for people."""
        if self.label is not None:
            return self.label(value)
        return f"{self.name} {'x ' if self.is_factor else ''}{value:g}"


def _scaled(name: str) -> Callable[[Any, float], Any]:
    """Multiplies a parameter of the robot, or of all its sections."""

    def apply(robot: Any, factor: float) -> Any:
        if robot.sections:
            return robot.with_sections(*(s.vary(**{name: factor}) for s in robot.sections))
        return replace(robot, **{name: getattr(robot, name) * factor})

    return apply


def _tendons(
    robot: Any, radius: float = 1.0, friction: float = 0.0, coefficient: float = 0.0
) -> Any:
    return replace(
        robot, tendons=tuple(t.vary(radius, friction, coefficient) for t in robot.tendons)
    )


def _without_tensions(robot: Any) -> str | None:
    if robot.drive.kind == "tension":
        return None
    return (
        f"tension_gain varies tensions that drives apply; robot {robot.name!r} is driven by length"
    )


def _without_servo_force(robot: Any) -> str | None:
    if robot.drive.force_limit < inf:
        return None
    return f"servo_force varies servos' force_limit; robot {robot.name!r} has none"


def _without_sensors(robot: Any) -> str | None:
    if robot.sensors:
        return None
    return f"sensor_errors varies curvature sensors; robot {robot.name!r} has none"


_SPRINGS = ("jnt_stiffness", "jnt_stiffnesspoly", "tendon_stiffness", "tendon_stiffnesspoly")
_DAMPERS = ("tendon_damping", "dof_damping")


def _factor(name: str, symbol: str, **options: Any) -> Variation:
    """A parameter of the robot, or of all its sections, that is multiplied."""
    return Variation(name, _scaled(name), label=f"{symbol} x {{:g}}".format, **options)


#: Factors and friction of the robot, what lies between it and the policy, and what is registered.
#: A varied Young's modulus keeps the damping time, hence scales D with K (thesis sec. 6.6.3).
_USUAL = (
    _factor("youngs_modulus", "E", scales=_SPRINGS + _DAMPERS),
    _factor("density", "rho", scales=("body_mass", "body_inertia")),
    _factor("damping_time", "mu", range=AMOUNTS, scales=_DAMPERS),
    Variation(
        "tendon_radius",
        lambda robot, factor: _tendons(robot, radius=factor),
        label="r_t x {:g}".format,
        shifts=("wrap_prm", "site_pos", "actuator_ctrlrange", "actuator_biasprm"),
        at_once=lambda robot: all(
            tendon.is_straight and not tendon.has_capstan_friction for tendon in robot.tendons
        ),
    ),
    Variation(
        "tendon_friction",
        lambda robot, force: _tendons(robot, friction=force),
        neutral=0.0,
        range=AMOUNTS,
        unit="N",
        label="friction {:g} N".format,
        shifts=("tendon_frictionloss",),
        switches=("tendon_solimp_fri", "tendon_solref_fri", "opt.disableflags"),
    ),
    Variation(
        "friction_coefficient",
        lambda robot, coefficient: _tendons(robot, coefficient=coefficient),
        neutral=0.0,
        range=(0.0, 10.0),
        label="friction coefficient + {:g}".format,
        shifts=("tendon_user",),
        at_once=lambda robot: all(tendon.friction_coefficient > 0 for tendon in robot.tendons),
    ),
    Variation(
        "servo_force",
        lambda robot, factor: replace(
            robot, drive=replace(robot.drive, force_limit=robot.drive.force_limit * factor)
        ),
        label="servo force x {:g}".format,
        shifts=("actuator_gainprm",),
        incompatibility=_without_servo_force,
    ),
    Variation("tension_gain", label="gain x {:g}".format, incompatibility=_without_tensions),
    Variation("delay", None, 0.0, (0.0, 1.0), "s", label=lambda time: f"delay {1e3 * time:g} ms"),
    Variation("sensor_noise", None, 0.0, (0.0, 10.0), label="noise x {:g}".format),
    Variation(
        "sensor_errors",
        None,
        0.0,
        (0.0, 5.0),
        label="sensor errors x {:g}".format,
        incompatibility=_without_sensors,
    ),
)

#: What varies, by name.
VARIATIONS: Registry[Variation] = Registry("variation", {one.name: one for one in _USUAL})


def register_variation(variation: Variation, replace: bool = False) -> None:
    """Add a varied parameter of robots, or replace one.

    Raises:
        ValueError: The name is taken and `replace` is not set, or there is nothing to apply.
    """
    if variation.apply is None:
        raise ValueError(f"variation {variation.name!r} needs a function `apply` of a robot")
    VARIATIONS.register(variation.name, variation, replace)


def find_variation(name: str) -> Variation:
    """The entry of a name; raises ValueError that lists the names."""
    if name not in VARIATIONS:
        raise ValueError(f"cannot vary {name!r}; choose from {', '.join(VARIATIONS)}")
    return VARIATIONS[name]


def check_variation(name: str, value: object) -> None:
    """Raise ValueError for an unknown name, or a value that it cannot have."""
    find_variation(name).check(value)


def neutral(robots_only: bool = False) -> dict[str, float]:
    """Values by name that change nothing, of everything or of parameters of robots alone."""
    return {
        name: one.neutral
        for name, one in VARIATIONS.items()
        if not (robots_only and one.apply is None)
    }


def varied(robot: Any, values: dict[str, float]) -> Any:
    """A robot with values by name, applied in the order of the table.

    Raises:
        ValueError: A name or a value that cannot be, or one that no robot has.
    """
    for name, value in values.items():
        check_variation(name, value)
        if VARIATIONS[name].apply is None:
            raise ValueError(f"{name} is no parameter of a robot: environments vary it")
    for name, one in VARIATIONS.registered().items():
        if name in values:
            robot = one.apply(robot, float(values[name]))
    return robot


def as_number(value: object) -> float | None:
    """The value as a float, None if it is no number (nor text, nor a truth value)."""
    return float(value) if isinstance(value, Real) and not isinstance(value, bool) else None
