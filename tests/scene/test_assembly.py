"""Several robots in one scene behave as each by itself, and can touch."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from softrobot_env.robots import ARM, RIG, ROBOTS, Base
from softrobot_env.scene.assembly import Assembly, Member, assembly_xml, build_assembly
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.mount import Mount
from softrobot_env.scene.objects import Contacts, Sphere
from softrobot_env.scene.registry import scene_of

FINGER = replace(scene_of(ROBOTS["planar_finger"]), pieces=6)
WEIGHT = (0.0, 0.0, -9.81)


def ring(count, radius, height=0.0, direction=(0.0, 0.0, 1.0)):
    """Bases on a ring whose robots' x axes point to its middle."""
    angles = 2 * np.pi * np.arange(count) / count
    return [
        Base((radius * np.cos(a), radius * np.sin(a), height), direction, roll=a + np.pi)
        for a in angles.tolist()
    ]


def gripper(**options):
    bases = ring(3, 0.035)
    members = [Member(f"finger{k + 1}", FINGER, base) for k, base in enumerate(bases)]
    return build_assembly(Assembly("gripper", tuple(members), **options))


def mixed(**options):
    """Robots that differ in all: planar on tensions, spatial on lengths, hanging and sideways."""
    spatial = SceneConfig(RIG, actuation="length", bending="spatial", pieces=2)
    trunk = scene_of(ROBOTS["hanging_trunk"])
    members = (
        Member("up", SceneConfig(replace(ARM, gravity=WEIGHT))),
        Member("side", spatial, Base((0.5, 0.3, 0.2), (1.0, 0.4, 0.3), roll=0.7)),
        Member("trunk", trunk),
    )
    return build_assembly(Assembly("mixed", members, **options))


def random_inputs(built, seed, amplitude=0.25):
    low, high = built.model.actuator_ctrlrange.T
    rng = np.random.default_rng(seed)
    return np.where(
        low < 0, rng.uniform(-0.01, 0.01, len(low)), amplitude * high * rng.random(len(low))
    )


def test_equilibrium_is_one_of_the_model_of_all_and_that_of_each_scene_alone():
    built = mixed()
    u = random_inputs(built, 3)
    q = built.equilibrium(u)
    data = mujoco.MjData(built.model)
    data.qpos[:], data.ctrl[:] = q, u
    mujoco.mj_forward(built.model, data)
    stiff = built.model.jnt_stiffness.max()
    assert np.abs(data.qfrc_smooth).max() < 1e-9 * stiff
    for name, part in built.parts.items():
        alone = build_scene(next(m for m in built.config.members if m.name == name).placed(None))
        found = alone.equilibrium(u[part.u])
        np.testing.assert_allclose(part.posture(q), found, atol=1e-10)
        np.testing.assert_allclose(part.tip(q), alone.tip(found), atol=1e-10)
        np.testing.assert_allclose(data.site(f"{name}/tip").xpos, alone.tip(found), atol=1e-10)
        s = np.linspace(0, alone.config.robot.length, 5)
        np.testing.assert_allclose(part.positions(q, s), alone.positions(found, s), atol=1e-10)
        np.testing.assert_allclose(part.curvature(q), alone.curvature(found), atol=1e-9)
        lengths = part.tendon_length(q)
        np.testing.assert_allclose(lengths, alone.tendon_length(found), atol=1e-10)


@pytest.mark.parametrize("integrator", [None, "implicitfast"])
def test_motion_is_that_of_each_scene_alone(integrator):
    """Ours within the accuracy that is wanted; MuJoCo's steps are the same to rounding."""
    step = None if integrator is None else 1e-3
    finger = replace(FINGER, integrator=integrator, timestep=step)
    arm = SceneConfig(ARM, integrator=integrator, timestep=step)
    hung = Base((0.3, 0.1, 0.4), (1.0, 0.0, -1.0))
    members = (Member("a", finger), Member("b", arm, hung), Member("c", finger, Base((0.2, 0, 0))))
    built = build_assembly(Assembly("three", members, gravity=WEIGHT))
    assert built.timestep.integrator == (integrator or "extrapolation")
    u = 0.3 * built.model.actuator_ctrlrange[:, 1] * np.tile([1.0, 0.0], built.n_inputs // 2)
    motion = built.simulate(0.3, u, samples=0.1)
    for part in built.parts.values():
        alone = part.scene.simulate(0.3, u[part.u], samples=0.1)
        truth, found = part.scene.tip(alone.q), part.tip(motion.q)
        bound = 1e-11 if integrator else built.timestep.accuracy + part.scene.timestep.accuracy
        assert np.abs(found - truth).max() < bound
        assert np.abs(np.diff(truth, axis=0)).max() > 20 * bound


def test_the_estimate_of_the_error_is_that_of_the_worst_robot():
    """A robot beside one that stands still is integrated as by itself, step for step."""
    still = replace(FINGER, robot=replace(FINGER.robot, name="still"))
    moving, quiet = Member("moving", FINGER), Member("quiet", still, Base((0.2, 0.0, 0.0)))
    estimates = []
    for members in ((moving,), (moving, quiet), (quiet, moving)):
        built = build_assembly(Assembly("pair", members))
        u = built.inputs(moving=np.array([3.0, 0.0, 0.0, 5.0]))
        estimates.append(built.simulate(0.2, u).integration_error[-1])
    assert estimates[0] > 0
    np.testing.assert_allclose(estimates, estimates[0], rtol=1e-6)


def test_exported_scene_is_the_compiled_one():
    built = gripper(gravity=WEIGHT)
    model = mujoco.MjModel.from_xml_string(assembly_xml(built.config))
    for field in ("body_mass", "jnt_stiffness", "dof_damping", "body_pos", "body_quat"):
        np.testing.assert_allclose(
            getattr(model, field), getattr(built.model, field), rtol=1e-5, atol=1e-9
        )
    assert [model.actuator(k).name for k in range(model.nu)] == list(built.input_names)


def test_fingers_do_not_touch_themselves_unless_asked():
    def pairs(**options):
        built = gripper(contacts=Contacts(**options))
        pairs = [built.model.pair(k).name.split("~") for k in range(built.model.npair)]
        return [(one.partition("/")[0], other.partition("/")[0]) for one, other in pairs]

    assert all(one != other for one, other in pairs())
    assert {("finger1", "finger2"), ("finger1", "finger3"), ("finger2", "finger3")} <= {*pairs()}
    assert ("finger1", "finger1") in pairs(self_contact=True)
    assert not pairs(between_robots=False)


def refused(match, **options):
    members = options.pop("members", (Member("a", FINGER),))
    with pytest.raises(ValueError, match=match):
        build_assembly(Assembly("wrong", members, **options))


def test_what_does_not_fit_together_is_refused_by_name():
    slow = replace(FINGER, control_period=0.02)
    heavy = replace(FINGER, robot=replace(FINGER.robot, gravity=WEIGHT))
    refused("needs a member", members=())
    refused("'a'", members=(Member("a", FINGER), Member("a", FINGER)))
    refused("differ in control_period", members=(Member("a", FINGER), Member("b", slow)))
    refused("different gravity", members=(Member("a", FINGER), Member("b", heavy)))
    refused("give contacts", objects=(Sphere(name="ball", radius=0.01),))
    refused("no object 'cup' to feel", felt="cup")
    refused("bending='spatial'", gravity=(0.0, 9.81, 0.0))
    refused("gravity must", gravity=(0.0, 1.0))
    touching = gripper(contacts=Contacts())
    with pytest.raises(ValueError, match="use `simulate`"):
        touching.equilibrium()
    moving = Member("a", FINGER, mount=Mount(("x",)))
    refused("contacts need one of MuJoCo's", members=(moving,), contacts=Contacts())
    with pytest.raises(ValueError, match="without '/'"):
        Member("a/b", FINGER)
    with pytest.raises(ValueError, match="belong to the assembly"):
        Member("a", replace(FINGER, contacts=Contacts()))
    with pytest.raises(KeyError, match="finger1, finger2, finger3"):
        gripper()["thumb"]
