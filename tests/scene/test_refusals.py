"""What scenes and their parts refuse, in words that name what is allowed."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from softrobot_env.beams.ancf import ANCF
from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.pcc import PCC
from softrobot_env.core.motion import State
from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.robots import ARM, CANTILEVER_WEAK, RIG
from softrobot_env.robots.loads import Load
from softrobot_env.scene.assembly import Assembly, Member, build_assembly
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import mean_curvature
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.inverse import InverseStatics
from softrobot_env.scene.mount import Mount
from softrobot_env.scene.objects import Contacts, Cylinder, Ground, Sphere
from softrobot_env.scene.registry import SCENES, model_scene
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.statics import equilibrium
from softrobot_env.scene.tangent import StaticForces
from softrobot_env.thesis.rig.spatial_piece import SUBPIECES

ROD = replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, 0.0))
WIDE = replace(CANTILEVER_WEAK, length=0.3, outer_radius=0.4)
THREAD = replace(ARM, outer_radius=1e-6, inner_radius=0.0, tendons=())
ENDS_EARLY = replace(ARM, tendons=(replace(ARM.tendons[0], end=0.2),))
UNEVEN = {"anisotropy": 0.1}, {"precurvature": (0.1, 0.0)}
POST = Cylinder(name="post", radius=0.03, length=0.2, position=(0.15, 0.0, 0.35))
ASLANT = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 1.0]])
BASE = "directions of a mount must be some of x, y, z"


def built(robot=ARM, **options):
    return build_scene(SceneConfig(robot, **options))


def of_arm(**changes):
    return built(replace(ARM, **changes))


def loaded(station=0.5, bending="planar", **load):
    return built(bending=bending, loads=(Load("push", station, **load),))


def touching(robot=ARM, **options):
    return built(robot, **{"pieces": 6, "contacts": Contacts(), "objects": (POST,)} | options)


def forces(kind, more=""):
    joint = f"<joint type='{kind}'/><geom size='1'/>"
    body = f"<worldbody><body>{joint}{more}</body></worldbody>"
    return StaticForces(mujoco.MjModel.from_xml_string(f"<mujoco>{body}</mujoco>"))


def at_rest(**arguments):
    return equilibrium(built().model, **{"ctrl": np.zeros(6)} | arguments)


@cache
def pushed():
    """A chain of 12 joints and a load."""
    return built(ROD, loads=(Load("push", 0.5, (1.0, 0, 0)),))


@cache
def mounted(direction="x", **options):
    """A robot on a slide."""
    member = Member("a", SceneConfig(ROD, **options), mount=Mount((direction,)))
    return build_assembly(Assembly("shaken", (member,)))


def shake(motion, name="a"):
    return mounted().simulate(0.1, mounts={name: motion})


@cache
def inverse(robot=ARM):
    return InverseStatics(build_scene(model_scene(robot)))


def mean_of(count, robot=RIG, **options):
    scene = built(robot, bending="spatial", **options)
    return mean_curvature(scene.model, scene.layout, count)


def driven(count, servos, simulation):
    simulation.drive_by(Servos(0.1, np.zeros(servos), np.zeros(servos), count))


#: Call -> what the message says.
REFUSED = [
    (lambda: built(rule="simpson"), "midpoint, gauss2"),
    (lambda: built(integrator="leapfrog"), "'implicitfast', 'discrete', 'implicit', 'Euler', 'RK4"),
    (lambda: built(actuation="pressure"), "actuation must be one of 'tension', 'length'"),
    (lambda: built(pieces=4), "multiple of their length"),
    (lambda: built(torsion=True), "bending='spatial'"),
    (lambda: of_arm(anisotropy=0.1), "bending='spatial'"),
    (lambda: of_arm(precurvature=(0.0, 0.1)), "bending='spatial'"),
    (lambda: of_arm(gravity=(0.0, 1.0, 9.81)), r"remove gravity \(y\) or choose bending='spatial'"),
    (lambda: built(THREAD), r"robot 'arm': a link of .* take fewer pieces"),
    (lambda: built(ENDS_EARLY), "ends inside a piece"),
    (lambda: built(actuation="length"), "'pair1_up' needs a finite stiffness"),
    (
        lambda: built(replace(ROD, bending_friction=1e-3), integrator="extrapolation"),
        "knows no friction of the backbone",
    ),
    *(
        (lambda x=x: built(accuracy=x), "accuracy must be")
        for x in (0.0, -1e-3, np.nan, np.inf, "0%", "much", "1 mm", True)
    ),
    (lambda: loaded(0.51), r"\[0, 0.5\] m"),
    (lambda: loaded(force=(1.0, 1.0, 0.0)), r"'push' \(force y\) or choose"),
    (lambda: loaded(moment=(1.0, 0.0, 0.0)), r"moment x or z.*='spatial'"),
    (
        lambda: loaded(moment=(0.0, 0.0, 1.0), bending="spatial"),
        r"cannot twist; remove load 'push' \(moment z\) or choose torsion=True",
    ),
    (lambda: touching(contacts=None), "give contacts=Contacts"),
    (lambda: touching(integrator="extrapolation"), "does not know contacts"),
    (lambda: touching(integrator="discrete"), "implicitfast, implicit, Euler"),
    (lambda: touching(objects=(POST, POST)), "different names"),
    (lambda: touching(WIDE), "longer than its radius"),
    (
        lambda: touching(contacts=Contacts(stiffness=1e10), timestep=5e-3),
        r"too stiff for a timestep of 0\.005 s",
    ),
    (lambda: touching().equilibrium(), "friction 0"),
    (lambda: Sphere(name="a", radius=0.1, mass=1.0, density=1.0), "not both"),
    (lambda: Ground(name="a", mass=1.0), "stands still"),
    # ------------------------------------------------------------ moving mounts
    *((lambda x=x: Mount(x), BASE) for x in ((), ("z", "x"), ("x", "x"), ("up",))),
    (lambda: mounted("y"), "bending='spatial'"),
    (lambda: mounted(integrator="implicitfast"), "needs our own integrator"),
    (lambda: shake(lambda t: [0.0], "arm"), "no mount of 'arm' moves; those of a do"),
    (lambda: shake(lambda t: [0.01 * np.sin(1e3 * t)]), "changes too fast"),
    (lambda: shake(lambda t: [0.0, 1.0]), "finite numbers along x"),
    (lambda: mounted().simulate(0.1, np.zeros((10, 0))), "constant, or a function of time"),
    (lambda: mounted().simulate(0.1, gravity=np.array([0.0, 9.81, 0.0])), "planar"),
    # ------------------------------------------------------------ motions and equilibria
    (lambda: pushed().simulate(0.015), "multiples of the control period of 0.01 s, got 0.015 s"),
    (lambda: pushed().simulate(-1.0), "duration must be positive"),
    (lambda: pushed().simulate(0.1, np.full(1, np.nan)), "controls must be finite"),
    (lambda: pushed().simulate(0.1, lambda t: np.full(1, np.inf)), "controls must be finite"),
    (lambda: pushed().simulate(0.1, np.zeros((3, 1))), "a row of inputs for each of 10 periods"),
    (lambda: pushed().simulate(0.1, gravity=[0, 0]), "need gravity of shape"),
    (lambda: pushed().simulate(0.1, start=State(np.zeros(3), np.zeros(12))), "need start.q"),
    (lambda: pushed().equilibrium(gravity=(0.0, 1.0, 9.81)), r"remove gravity \(y\)"),
    (lambda: pushed().positions(np.zeros(12), 2.0), "stations must lie between 0 and"),
    (lambda: pushed().positions(np.zeros(3), 0.1), "need postures of 12 numbers each"),
    (lambda: pushed().positions(np.zeros(12), [0.1], [[0, 0, 0]]), "offsets must have shape"),
    *((lambda n=n: at_rest(load_steps=n), "whole number, at least one") for n in (0, -1, 1.5)),
    (lambda: at_rest(ctrl=np.full(6, -1.0)), r"'pair1_up' must lie in \[0, 80\]"),
    (lambda: at_rest(ctrl=np.full(6, 80.1)), r"'pair1_up' must lie in \[0, 80\]"),
    (lambda: at_rest(ctrl=np.full(6, np.nan)), "controls must be finite, got nan"),
    (lambda: at_rest(ctrl=np.zeros(5)), r"need controls of shape \(6,\), got \(5,\)"),
    (lambda: at_rest(guess=np.full(12, np.inf)), "the guess must be finite, got inf"),
    (lambda: at_rest(gravity=(0.0, np.nan, 0.0)), "gravity must be finite, got nan"),
    (lambda: at_rest(gravity=(0.0, 9.81)), r"need gravity of shape \(3,\)"),
    (lambda: inverse(CANTILEVER_WEAK), "'cantilever_weak' has no tendons"),
    (lambda: InverseStatics(inverse().scene, ASLANT), "at right angles"),
    (lambda: inverse().solve(np.zeros((2, 2))), "points"),
    (lambda: inverse().solve(np.zeros((2, 3)), np.zeros(2)), "start"),
    # ------------------------------------------------------------ parts
    (lambda: forces("slide"), "known for hinges and ball joints only"),
    (lambda: forces("hinge", "<body><geom size='1'/><joint/></body>" * 2), "one chain of joints"),
    (lambda: mean_of(3, pieces=4), "multiple of 3 pieces"),
    (lambda: mean_of(6, CANTILEVER_WEAK, rule="gauss2", torsion=True), "a chain of hinges"),
    (
        lambda: driven(3, 3, BatchSimulation(build_scene(SCENES["rig"]), 2)),
        r"drives \(2, 3\), .* got \(3, 3\)",
    ),
    (
        lambda: driven(None, 2, Simulation(build_scene(SCENES["rig"]))),
        r"drives \(3,\), .* got \(2,\)",
    ),
    (lambda: driven(None, 6, Simulation(built())), "this scene's in tension"),
    *((lambda x=x: x(RIG, 4), "'rig' has a head") for x in (PCC, CosseratRod, ANCF)),
    (lambda: PCC(RIG, inertia="distributed"), "has a head"),
    *(
        (lambda x=x: PCC(replace(RIG, **x), inertia=SUBPIECES), "no anisotropy and no precurvature")
        for x in UNEVEN
    ),
]


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.parametrize(("call", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
