"""MuJoCo's own rods: the discrete elastic rod (a flex) of MuJoCo 4, and the cable of MuJoCo 3.

MuJoCo 4 has no cable any more, so the cable runs in a process with an older MuJoCo, which reads
requests and writes answers as JSON; hence this file imports MuJoCo and NumPy alone.

Both are set up as their makers intend (manual, "Rods" and "Deformables"; changelog 4.0), and so
that their errors are of second order:

flex: n edges of equal length between points that slide, with half a mass at the tip. Each vertex
bends by EI / l, l being the mean of its edges. The manual clamps a rod by pinning its first edge:
taken as it is, half an edge too much is rigid. Here the pinned edge is a short one before the
clamp, so that the vertex at the clamp has half a cell, as it should. Equality constraints keep the
edges' length as nearly as MuJoCo allows. A vertex has no orientation: moments, and loads that
follow the tip, act on a body that holds a short last edge, which flexcomp cannot make by itself.
MuJoCo twists that body explicitly, whatever the integrator: its stable timestep falls with 1 / n^2
without damping, with 1 / n^4 with much of it.

cable: rigid links with ball joints of stiffness EI / l and GJ / l. The first link, which is fixed,
and the last one reach half a link beyond the rod, so that joints are in the middle of cells of
length l; the mass beyond the tip is taken off.
"""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import pi, sqrt
from time import perf_counter

import mujoco
import numpy as np
from numpy import ndarray

#: Length of the flex' clamped edges, as a share of the others.
_SHORT = 1e-3

#: Steps between looks at a rod that comes to rest; the most of them; how far [lengths] the tip
#: moves in the last ones.
_LOOK, _MOST, _STILL = 10, 30_000, 1e-8

#: Longest time [s] spent on repeats.
_BUDGET = 2.0

#: A diverged state is reset, which only these tell.
_DIVERGED = ("mjWARN_BADQPOS", "mjWARN_BADQVEL", "mjWARN_BADQACC")

_TIP_BODY = (
    '<body name="tip" pos="0 0 {!r}"><joint type="free" damping="{!r}"/><site name="tip"/>'
    '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
)

_OPTION = (
    '<option timestep="{h!r}" integrator="{integrator}" gravity="{gravity}" tolerance="1e-10">'
    '<flag contact="disable"/></option>'
)


@dataclass(frozen=True)
class Rod:
    """A clamped rod along +z with a load on its tip, in SI units.

    Attributes:
        length, radius, youngs_modulus, poisson_ratio, density: Of a solid cylinder.
        damping_time: [s], viscous over elastic moment.
        gravity: (3,) [m/s2].
        force, moment: (3,) [N] and [N m] on the tip.
        follows: Whether they turn with the tip's section.
    """

    length: float
    radius: float
    youngs_modulus: float
    poisson_ratio: float
    density: float
    damping_time: float
    gravity: Sequence[float] = (0.0, 0.0, 0.0)
    force: Sequence[float] = (0.0, 0.0, 0.0)
    moment: Sequence[float] = (0.0, 0.0, 0.0)
    follows: bool = False

    @property
    def shear_modulus(self) -> float:
        """[Pa]."""
        return self.youngs_modulus / (2 * (1 + self.poisson_ratio))

    @property
    def bending_stiffness(self) -> float:
        """EI [N m2]."""
        return self.youngs_modulus * pi * self.radius**4 / 4

    @property
    def torsional_stiffness(self) -> float:
        """GJ [N m2]."""
        return self.shear_modulus * pi * self.radius**4 / 2

    @property
    def moves_section(self) -> bool:
        """Whether the load needs an orientation of the tip."""
        return self.follows or any(self.moment)

    @property
    def mass(self) -> float:
        """[kg]."""
        return self.density * pi * self.radius**2 * self.length

    @property
    def time_scale(self) -> float:
        """[s], one over the first angular frequency."""
        return sqrt(self.mass * self.length**3 / self.bending_stiffness) / 3.516


class Flex:
    """A discrete elastic rod.

    Args:
        rod: The rod.
        n: Edges.
        timestep: [s].
        damping_time: [s], in place of the rod's own; None for that.
        tip_damping: [N m s] and [N s/m] of the body that holds the tip, if one does.
    """

    def __init__(
        self,
        rod: Rod,
        n: int,
        timestep: float,
        damping_time: float | None = None,
        tip_damping: float = 0.0,
    ) -> None:
        self.rod = rod
        edge, damping = rod.length / n, rod.damping_time if damping_time is None else damping_time
        held = rod.moves_section
        places = [-_SHORT * edge, *(edge * np.arange(n + 1)).tolist()]
        places += [rod.length + _SHORT * edge] if held else []
        count = len(places)
        spec = mujoco.MjSpec.from_string(f"""<mujoco>
            {_option(rod, timestep, "discrete")}
            <worldbody>
              {_TIP_BODY.format(rod.length, tip_damping) if held else ""}
              <flexcomp name="rod" type="direct" dim="1" radius="{rod.radius!r}"
                mass="{rod.mass!r}" point="{" ".join(f"0 0 {z!r}" for z in places)}"
                element="{" ".join(f"{k} {k + 1}" for k in range(count - 1))}">
                <pin id="0 1"/>
                <edge equality="true" solref="-1e8 -1e4" solimp=".9999 .9999 .001"/>
                <elasticity young="{rod.youngs_modulus!r}" poisson="{rod.poisson_ratio!r}"
                  damping="{damping!r}"/>
                <contact contype="0" conaffinity="0" selfcollide="none"/>
              </flexcomp></worldbody></mujoco>""")
        for k in range(2, n + 1):
            spec.body(f"rod_{k}").mass = rod.mass / n
        if held:
            flex, places = spec.flex("rod"), np.reshape(spec.flex("rod").vert, (-1, 3))
            places[-2:] = (0, 0, 0), (0, 0, _SHORT * edge)
            flex.vert, flex.vertbody = places.ravel(), [*list(flex.vertbody)[:-2], "tip", "tip"]
            for name in (f"rod_{n + 1}", f"rod_{n + 2}", "rod_twist"):
                spec.delete(spec.body(name))
            _follow(spec, rod)
        tip, mass = spec.body("tip" if held else f"rod_{n + 1}"), rod.mass / n / 2
        tip.mass, tip.inertia = mass, [mass * edge**2 / 12] * 3
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._tip = self.model.body(tip.name).id

    def reset(self) -> None:
        """Put the rod straight, at rest, and under its load."""
        _reset(self.rod, self.data, self._tip)

    @property
    def tip(self) -> ndarray:
        """(3,) [m]."""
        return self.data.xpos[self._tip].copy()


class Cable:
    """The cable; arguments as of `Flex`, but for what is said here.

    Args:
        armature: [kg m2] added to each ball joint, which makes a way to rest shorter.
    """

    def __init__(
        self,
        rod: Rod,
        n: int,
        timestep: float,
        damping_time: float | None = None,
        armature: float = 0.0,
    ) -> None:
        self.rod, link = rod, rod.length / n
        damping = rod.damping_time if damping_time is None else damping_time
        damping *= rod.bending_stiffness / link
        spec = mujoco.MjSpec.from_string(f"""<mujoco>
            {_option(rod, timestep, "implicitfast")}
            <extension><plugin plugin="mujoco.elasticity.cable"/></extension>
            <worldbody><body pos="0 0 {-link / 2!r}">
              <composite type="cable" curve="0 0 s" count="{n + 2} 1 1" initial="none"
                size="{rod.length + link!r}" offset="0 0 0">
                <plugin plugin="mujoco.elasticity.cable">
                  <config key="twist" value="{rod.shear_modulus!r}"/>
                  <config key="bend" value="{rod.youngs_modulus!r}"/>
                </plugin>
                <joint kind="main" damping="{damping!r}" armature="{armature!r}"/>
                <geom type="cylinder" size="{rod.radius!r}" density="{rod.density!r}"
                  contype="0" conaffinity="0"/>
              </composite></body></worldbody></mujoco>""")
        straight = mujoco.MjData(spec.compile())
        mujoco.mj_forward(straight.model, straight)
        last, mass = spec.body("B_last"), rod.mass / n / 2
        last.mass, last.ipos, last.explicitinertial = mass, (link / 4, 0, 0), True
        last.iquat, side = (1, 0, 0, 0), mass * (rod.radius**2 / 4 + (link / 2) ** 2 / 12)
        last.inertia = (mass * rod.radius**2 / 2, side, side)
        # A body in the middle of the last link, with the world's axes while the rod is straight.
        back = np.empty(4)
        mujoco.mju_negQuat(back, straight.body("B_last").xquat)
        small = {"mass": 1e-6 * mass, "inertia": [1e-6 * side] * 3, "ipos": (0, 0, 0)}
        tip = last.add_body(name="tip", pos=(link / 2, 0, 0), quat=back, **small)
        tip.iquat, tip.explicitinertial = (1, 0, 0, 0), True
        tip.add_site(name="tip")
        _follow(spec, rod)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._tip = self.model.body("tip").id

    def reset(self) -> None:
        """Put the rod straight, at rest, and under its load."""
        _reset(self.rod, self.data, self._tip)

    @property
    def tip(self) -> ndarray:
        """(3,) [m]."""
        return self.data.xpos[self._tip].copy()


#: Name of a model -> what makes it.
MODELS: dict[str, Callable[..., Flex | Cable]] = {"mujoco_flex": Flex, "mujoco_cable": Cable}


def _option(rod: Rod, timestep: float, integrator: str) -> str:
    gravity = " ".join(map(repr, map(float, rod.gravity)))
    return _OPTION.format(h=timestep, integrator=integrator, gravity=gravity)


def _follow(spec: mujoco.MjSpec, rod: Rod) -> None:
    """Add the motor of a load that turns with the site "tip"."""
    if rod.follows:
        motor = spec.add_actuator(target="tip", trntype=mujoco.mjtTrn.mjTRN_SITE)
        motor.gear = (*rod.force, *rod.moment)


def _reset(rod: Rod, data: mujoco.MjData, tip: int) -> None:
    mujoco.mj_resetData(data.model, data)
    if rod.follows:
        data.ctrl[:] = 1.0
    else:
        data.xfrc_applied[tip] = (*rod.force, *rod.moment)
    mujoco.mj_kinematics(data.model, data)


def resting(model: str, rod: Rod, n: int, share: float) -> Flex | Cable:
    """A model that comes to rest quickly, with steps of a share of the rod's time scale.

    The flex is damped critically in its first mode. Where a body holds its tip, that body's joint
    is damped instead, in proportion to the twisting stiffness GJ / l, as the flex twists the body
    explicitly. The cable has armatures that outweigh its links and are equal, which gives all modes
    one frequency, so that steps need not be short for the fast ones.
    """
    scale, step = rod.time_scale, share * rod.time_scale
    if model == "mujoco_flex" and not rod.moves_section:
        return Flex(rod, n, step, 2 * scale)
    if model == "mujoco_flex":
        return Flex(rod, n, step, step, 8 * step * rod.torsional_stiffness * n / rod.length)
    scale *= 20 * n
    armature = rod.bending_stiffness * n / rod.length * scale**2
    return Cable(rod, n, share * scale, 2 * scale, armature)


def rest(rod: Flex | Cable) -> ndarray:
    """Tip (3,) [m] at rest, reached from the straight rod.

    Raises:
        RuntimeError: The rod does not come to rest, or diverges.
    """
    rod.reset()
    before = rod.tip
    for _ in range(_MOST // _LOOK):
        mujoco.mj_step(rod.model, rod.data, nstep=_LOOK)
        _check(rod)
        after = rod.tip
        if np.linalg.norm(after - before) < _STILL * rod.rod.length:
            return after
        before = after
    raise RuntimeError(f"not at rest after {_MOST} steps")


def motion(rod: Flex | Cable, period: float, samples: int) -> ndarray:
    """Tips (1 + samples, 3) [m] from the straight rod on, a period [s] apart.

    Raises:
        RuntimeError: The rod diverges.
    """
    rod.reset()
    steps = round(period / rod.model.opt.timestep)
    tips = [rod.tip]
    for _ in range(samples):
        mujoco.mj_step(rod.model, rod.data, nstep=steps)
        _check(rod)
        tips.append(rod.tip)
    return np.array(tips)


def _check(rod: Flex | Cable) -> None:
    bad = any(rod.data.warning[getattr(mujoco.mjtWarning, kind)].number for kind in _DIVERGED)
    if bad or not np.linalg.norm(rod.tip) < 2 * rod.rod.length:
        raise RuntimeError(f"diverged with a timestep of {1e3 * rod.model.opt.timestep:.3g} ms")


def answer(request: dict) -> dict:
    """Tips [m], timestep [s], best wall time [s] and version for a request, or its failure.

    Args:
        request: `model`, `rod`, `n` and `repeats`; `share` of a rest; `timestep`, `period` and
            `samples` of a motion.
    """
    model, rod, n = request["model"], Rod(**request["rod"]), request["n"]
    if "share" in request:
        made = resting(model, rod, n, request["share"])
        run = partial(rest, made)
    else:
        made = MODELS[model](rod, n, request["timestep"])
        run = partial(motion, made, request["period"], request["samples"])
    option = made.model.opt
    kind = mujoco.mjtIntegrator(option.integrator).name.removeprefix("mjINT_").lower()
    found = {"version": mujoco.__version__, "timestep": option.timestep, "integrator": kind}
    times = []
    try:
        for _ in range(request["repeats"]):
            begin = perf_counter()
            tips = run()
            times.append(perf_counter() - begin)
            if sum(times) > _BUDGET:
                break
    except RuntimeError as error:
        return found | {"failure": str(error)}
    return found | {"tips": tips.tolist(), "wall_time": min(times)}


if __name__ == "__main__":
    mujoco.set_mju_user_warning(lambda message: None)
    json.dump([answer(request) for request in json.load(sys.stdin)], sys.stdout)
