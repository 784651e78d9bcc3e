"""Digital twins of robots driven by length: robots with errors that are unknown to controllers.

A twin represents one built robot. It is sampled from:

* Young's modulus around 0.9 of the nominal one, tendons turned by 7 degrees: inferred by
  recomputation, these two reproduce the errors of the thesis' model-based controllers (audit sec.
  2, model mismatch; Tabs. 5.2 and 5.3);
* of a robot whose parameters are those of another model than a chain, such as the rig of the
  thesis, the modulus of its chain (`RobotEntry.stiffer`);
* friction of 0.05 N in every tendon (fitted): with it, networks of a simulated rig that is
  measured without dither have the errors that the thesis reports, 0.72 mm at the tip and 0.12 mm in
  the lengths (thesis: 0.77 and 0.11); 0.1 N gives 1.2 and 0.18 mm, 0.3 N 3.1 and 0.48 mm
  (`softrobot benchmark rig_networks`). Twins are measured with dither, which more than halves these
  errors;
* damping within 20 % of the nominal one, whose unit the audit had to infer, regardless of the
  modulus;
* curvature sensors with the usual imperfections (`robots.sensors.USUAL`);
* everything else: assumptions of this package about a silicone body cast by hand, tendons laid by
  hand, hobby servos and a webcam of 90 frames a second.
"""

from dataclasses import dataclass, replace
from math import pi, radians
from typing import Annotated

import numpy as np
from numpy import ndarray

from softrobot_env.core.records import NotNegative, Range, check_fields
from softrobot_env.core.registry import served

from .actuation import robot_inputs
from .parameters import RobotParams, Tendon
from .registry import CAMERA_PERIOD, entry_of

#: Largest standard deviation [m] of a camera's noise, and largest error [m] of a servo: offset plus
#: half of the backlash. Observation spaces leave room for them.
LARGEST_NOISE, LARGEST_ERROR = 2e-3, 8e-3

#: Spreads of `sampled_twin`: of the logarithm of Young's modulus [1] the standard deviation, of the
#: others the largest deviation. The tip of the straight rig moves by L (L / 2 + output) per
#: precurvature: 0.1 1/m are 2 mm.
MODULUS, MODULUS_SPREAD = 0.9, 0.05
ANISOTROPY = 0.05
PRECURVATURE = 0.1  # 1/m
TURN, TURN_SPREAD, AZIMUTH_SPREAD = radians(7), radians(2), radians(1)
RADIUS_SPREAD = 0.03
FRICTION, FRICTION_SPREAD = 0.05, 0.3  # N, 1
OFFSET = 0.3e-3  # m
BACKLASH = (0.1e-3, 0.3e-3)  # m
CAMERA_NOISE = 0.3e-3  # m
DAMPING_SPREAD = 0.2  # 1, of c_theta

#: A usual drive: friction coefficient; of servos the error over the travel [1] at which the force
#: is at its limit, time constant and dead time [s], friction of the gear over the limit [1], and
#: counts of the encoder in the travel [1].
COEFFICIENT, SOFTNESS, LAG, DEAD_TIME, GEAR_FRICTION, COUNTS = 0.15, 0.05, 0.01, 0.008, 0.02, 2000


@dataclass(frozen=True)
class Twin:
    """A rig as built: robot, servos and camera.

    Attributes:
        robot: The robot, driven by length; its tendons are numbered as the servos.
        servo_speed: [m/s], how fast a servo can wind up a tendon.
        servo_offset: (n_tendons,) [m], pulled in when the command is zero.
        backlash: (n_tendons,) [m], width of the servos' dead band.
        camera_noise: [m], standard deviation of each coordinate.
        camera_delay: [s]; environments round it to whole control periods.
        seed: What it was sampled from, None if nothing was.
    """

    robot: RobotParams
    servo_speed: Annotated[float, Range("positive, or inf", lambda x: x > 0)]
    servo_offset: tuple[float, ...]
    backlash: tuple[NotNegative, ...]
    camera_noise: NotNegative = 0.0
    camera_delay: NotNegative = 0.0
    seed: int | None = None

    def __post_init__(self) -> None:
        check_fields(self, "twin")
        tendons = len(self.robot.tendons)
        if not tendons == len(self.servo_offset) == len(self.backlash):
            raise ValueError(
                f"a twin needs a servo_offset and a backlash for each of {tendons} tendons, got "
                f"{len(self.servo_offset)} and {len(self.backlash)}"
            )
        for offset, width in zip(self.servo_offset, self.backlash, strict=True):
            if not abs(offset) + width / 2 <= LARGEST_ERROR:
                raise ValueError(
                    f"servo_offset plus half of the backlash must be at most {LARGEST_ERROR:g} m, "
                    f"got {offset} and {width} m"
                )
        if not self.camera_noise <= LARGEST_NOISE:
            raise ValueError(
                f"camera_noise must lie in [0, {LARGEST_NOISE:g}] m, got {self.camera_noise!r}"
            )

    @property
    def rest_offset(self) -> ndarray:
        """(n_tendons,) [m], what horns at rest have more than commands, but for what servos give.

        A servo of any force may rest in the middle of its backlash, another is pulled to its end.
        """
        lost = 0.0 if self.robot.drive.gain is None else np.array(self.backlash) / 2
        return np.array(self.servo_offset) - lost


def nominal_twin(robot: RobotParams) -> Twin:
    """A robot as its parameters say, with the servos of its drive, which have no offset."""
    none = (0.0,) * len(robot.tendons)
    backlash = (robot.drive.backlash,) * len(none)
    return Twin(robot, robot.drive.speed, none, backlash)


def sampled_twin(robot: RobotParams, seed: int) -> Twin:
    """A robot with errors of manufacturing, of its servos and its camera, sampled from a seed.

    Raises:
        ValueError: The robot is driven by tension, or the seed is no whole number of zero or more.
    """
    if robot.drive.kind != "length":
        raise ValueError(f"a twin has servos; robot {robot.name!r} is driven by tension")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"the seed of a twin must be a whole number >= 0, got {seed!r}")
    rng, count = np.random.default_rng(np.random.SeedSequence(int(seed))), len(robot.tendons)
    stiffer = entry_of(robot).stiffer
    modulus = stiffer * MODULUS * float(np.exp(MODULUS_SPREAD * rng.standard_normal()))
    built = _built(rng, robot.vary(youngs_modulus=modulus), int(seed))
    offset, backlash = _each(rng, count, -OFFSET, OFFSET), _each(rng, count, *BACKLASH)
    backlash = tuple(robot.drive.backlash + more for more in backlash)
    damping = stiffer / modulus * float(1 + rng.uniform(-DAMPING_SPREAD, DAMPING_SPREAD))
    return Twin(
        robot=replace(built.vary(damping_time=damping), name=f"{robot.name}_twin"),
        servo_speed=robot.drive.speed,
        servo_offset=offset,
        backlash=backlash,
        camera_noise=CAMERA_NOISE,
        camera_delay=CAMERA_PERIOD,
        seed=int(seed),
    )


def twin_of(robot: RobotParams, twin: "Twin | int | None") -> Twin:
    """A robot as it is simulated: a twin, that of a seed, or without one what its parameters say.

    Raises:
        ValueError: As `sampled_twin`.
    """
    if isinstance(twin, Twin):
        return twin
    if twin is None:
        return nominal_twin(entry_of(robot).chain or robot)
    return sampled_twin(robot, twin)


def with_real_drive(robot: RobotParams) -> RobotParams:
    """A robot with a usual drive of real ones, unless its file says what its own is like.

    Tendons rub. Servos of any force get one, no larger than their tendons' largest limit, and what
    else motors and gears have; those of tensions reach their limits anyway.
    """
    if not robot.has_capstan_friction:
        rubbing = (replace(t, friction_coefficient=COEFFICIENT) for t in robot.tendons)
        robot = replace(robot, tendons=tuple(rubbing))
    if robot.drive.kind == "tension" or robot.drive.gain is not None:
        return robot
    travel = float(robot_inputs(robot).input_scale.max())
    limit = float(robot.of_tendons("tension_limit").max())
    gain = limit / (SOFTNESS * travel)
    forced = replace(
        robot.drive,
        gain=gain,
        velocity_gain=gain * LAG,
        force_limit=limit,
        reflected_mass=gain * LAG**2 / 2,
        gear_friction=GEAR_FRICTION * limit,
        encoder_step=travel / COUNTS,
        command_delay=DEAD_TIME,
    )
    return replace(robot, drive=forced)


def _built(rng: np.random.Generator, robot: RobotParams, specimen: int) -> RobotParams:
    """A robot of some material with the other errors of manufacturing."""
    bend = PRECURVATURE * np.sqrt(rng.uniform()) * np.exp(2j * pi * rng.uniform())
    return replace(
        robot,
        anisotropy=float(rng.uniform(0, ANISOTROPY)),
        stiff_azimuth=float(rng.uniform(0, pi)),
        precurvature=(float(bend.real), float(bend.imag)),
        tendons=_laid(rng, robot.tendons),
        sensors=tuple(sensor.with_imperfections(1.0, specimen) for sensor in robot.sensors),
    )


def _laid(rng: np.random.Generator, tendons: tuple[Tendon, ...]) -> tuple[Tendon, ...]:
    """Tendons where they really are, with friction."""
    common, count = TURN + rng.uniform(-TURN_SPREAD, TURN_SPREAD), len(tendons)
    turn = common + np.array(_each(rng, count, -AZIMUTH_SPREAD, AZIMUTH_SPREAD))
    scale = _each(rng, count, 1 - RADIUS_SPREAD, 1 + RADIUS_SPREAD)
    low, high = FRICTION * (1 - FRICTION_SPREAD), FRICTION * (1 + FRICTION_SPREAD)
    return tuple(
        replace(tendon.turned(float(a), r), friction=f)
        for tendon, a, r, f in zip(tendons, turn, scale, _each(rng, count, low, high), strict=True)
    )


def _each(rng: np.random.Generator, count: int, low: float, high: float) -> tuple[float, ...]:
    """One number for each tendon."""
    return tuple(rng.uniform(low, high, count).tolist())


#: Its name up to version 0.2.
drawn_twin = sampled_twin

__getattr__ = served(__name__)
