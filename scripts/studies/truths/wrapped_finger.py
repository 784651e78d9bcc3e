"""A finger wrapped round a cylinder by its tendon: closed form.

The finger is inextensible, clamped along a tangent of the cylinder, and does not rub. At arc length
s its tendon, with tension T, bends it by the moment T a(s), where the arm a falls steadily from the
base to the tip by c a unit length. Round the cylinder its curvature is 1 / rho, rho being the
radius of the cylinder and the distance to the neutral fibre together. With the total moment
m = EI / rho - T a(s), shear V and tension N of a cross-section (fibre and tendon together),

    V = -m' = -T c,    N' = V / rho,    q = N / rho,

q is the force per length from the cylinder. Beyond s* the finger is free, so that there
T a(s*) = EI / rho, and the moment is continuous while the shear is not: a force T c presses at s*,
and q = T c (s* - s) / rho^2 between it and the base. (A tendon at a constant distance, c = 0,
presses nowhere: what it takes is borne by the compression of the fibre. It reaches the tip at once,
and what is beyond bends the tip into the cylinder.)
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class WrappedFinger:
    """A wrapped finger.

    Attributes:
        end: s* [m], arc length up to which it lies on the cylinder.
        curvature: [1/m], up to there.
        end_force: [N], at that place.
        base_pressure: [N/m], at the base; it falls steadily to none at `end`.
        turn: [rad], angle round the cylinder.
    """

    end: float
    curvature: float
    end_force: float
    base_pressure: float
    turn: float

    def pressure(self, s: float) -> float:
        """Force per length [N/m] at an arc length [m] up to `end`."""
        return self.base_pressure * (1 - s / self.end)

    def pressed(self, start: float = 0.0) -> float:
        """Sum [N] of the sizes of the forces beyond an arc length [m]."""
        return self.end_force + self.pressure(start) * (self.end - start) / 2

    @property
    def force(self) -> tuple[float, float]:
        """Sum [N] of the forces on the finger: away from the cylinder at the base, and along it.

        What the clamp bears: shear and tension at the base.
        """
        return self.end_force, self.end_force * self.turn


def wrapped_finger(
    length: float, stiffness: float, tension: float, arms: tuple[float, float], radius: float
) -> WrappedFinger:
    """The solution.

    Args:
        length: [m].
        stiffness: EI [N m2].
        tension: [N].
        arms: a [m] at the base and at the tip.
        radius: rho [m].

    Raises:
        ValueError: The tension is too small to touch the cylinder beyond the base, or so large that
            the tip bends away; the message tells the range.
    """
    least, most = (stiffness / (radius * arm) for arm in arms)
    if not least < tension < most:
        raise ValueError(
            f"a finger lies on the cylinder between {least:.4g} and {most:.4g} N, got {tension:g} N"
        )
    slope = (arms[0] - arms[1]) / length
    end = (arms[0] - stiffness / (radius * tension)) / slope
    force = tension * slope
    return WrappedFinger(end, 1 / radius, force, force * end / radius**2, end / radius)
