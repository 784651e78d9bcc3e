"""What the numbers of a robot may be: one table, in SI units, wide but finite.

A robot of a micrometre fits in and one of a kilometre, gel and diamond; a slip of a unit does not.
Fields of robots, and so their files, have these types; messages name the key, the value and the
range. What has to fit to something else, such as a tendon to its robot, is checked there.
"""

from math import inf, pi
from typing import Annotated, Any

from softrobot_env.core.records import Range, Unit, whole_numbers


def _within(low: float, high: float, unit: str, or_inf: bool = False) -> Any:
    """A number in a range, with its unit."""
    shown = "" if unit == "1" else f" {unit}"
    text = f"from {low:g} to {high:g}{shown}{', or inf' if or_inf else ''}"
    allowed = Range(text, lambda x: low <= x <= high or (or_inf and x == inf))
    return Annotated[float, allowed] if unit == "1" else Annotated[float, allowed, Unit(unit)]


# ---------------------------------------------------------------- geometry
Length = _within(1e-6, 1e3, "m")
Station = _within(0, 1e3, "m")
Radius = _within(1e-7, 1e2, "m")
Bore = _within(0, 1e2, "m")
Place = _within(-1e3, 1e3, "m")  # in a cross-section
Position = _within(-1e4, 1e4, "m")
Component = _within(-1e6, 1e6, "1")  # of a direction
Angle = _within(-1e4, 1e4, "rad")
Degrees = _within(-1e6, 1e6, "deg")
Turns = _within(-1e3, 1e3, "1")
Curvature = _within(-1e8, 1e8, "1/m")
#: Share of the outer radius that a wall is at least, so that it has an area in floating point.
THINNEST = 1e-9

# ---------------------------------------------------------------- material
#: Diamond has 1e12; what beams tend to in a limit, such as no thickness, has far more.
Modulus = _within(10, 1e20, "Pa")
#: Osmium has 2.3e4, an aerogel 1; limits without mass or thickness need the rest.
Density = _within(1e-9, 1e12, "kg/m3")
DampingTime = _within(0, 1e6, "s")
PoissonRatio = Annotated[float, Range("in (-1, 0.5]", lambda nu: -1 < nu <= 0.5)]
Anisotropy = Annotated[float, Range("in [0, 2)", lambda x: 0 <= x < 2)]
Mass = _within(1e-15, 1e6, "kg")
Inertia = _within(1e-27, 1e12, "kg m2")
Acceleration = _within(-1e5, 1e5, "m/s2")

# ---------------------------------------------------------------- tendons and drives
Tension = _within(1e-12, 1e12, "N")
Force = _within(0, 1e12, "N")
Moment = _within(0, 1e12, "N m")
Stiffness = _within(1e-9, 1e18, "N/m", or_inf=True)
FrictionCoefficient = _within(0, 10, "1")
BendAngle = _within(0, 1e3, "rad")
ForceLimit = _within(1e-12, 1e12, "N", or_inf=True)
Speed = _within(1e-9, 1e4, "m/s", or_inf=True)
Gain = _within(1e-9, 1e12, "N/m")
VelocityGain = _within(0, 1e12, "N s/m")
ReflectedMass = _within(0, 1e6, "kg")
DeadTime = _within(0, 10, "s")

# ---------------------------------------------------------------- sensors
Rate = _within(1e-3, 1e6, "Hz")
Delay = _within(0, 10, "s")
Warming = _within(-1e3, 1e3, "K")
Noise = _within(0, 1e6, "1")
PerStrain = _within(0, 1e6, "1")
PerForce = _within(0, 1e6, "1/N")
Spread = Annotated[float, Range("in [0, 0.3]", lambda x: 0 <= x <= 0.3)]
PartOfLight = Annotated[float, Range("in [0, 1)", lambda x: 0 <= x < 1)]
_Acute = Range("an angle in (0, pi / 2)", lambda x: 0 < x < pi / 2)
Acceptance = Annotated[float, _Acute, Unit("rad")]

# ---------------------------------------------------------------- counts
#: Of a section, robot or scene.
Pieces = Annotated[int, whole_numbers(1, 1_000)]
Group = Annotated[int, whole_numbers(0, 9_999)]
Segments = Annotated[int, whole_numbers(1, 1_000)]
Specimen = Annotated[int, whole_numbers(0, 2**63 - 1)]
