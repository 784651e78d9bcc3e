"""Contacts: forces against exact solutions, friction, and scenes that have none."""

import pickle
from dataclasses import replace
from math import atan, cos, degrees, pi, radians, sin

import mujoco
import numpy as np
import pytest
from support.postures import net_force

from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.core.motion import State
from softrobot_env.robots import ARM, ROBOTS, Base, RobotParams, Section
from softrobot_env.robots.loads import Load
from softrobot_env.scene import statics
from softrobot_env.scene.build import build_scene, scene_xml, vary_scene
from softrobot_env.scene.chain import joint_angles
from softrobot_env.scene.config import SceneConfig, TipSensors, visible
from softrobot_env.scene.contacts import BACKBONE
from softrobot_env.scene.objects import Box, Capsule, Contacts, Cylinder, Ellipsoid, Ground, Sphere
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.timestep import TimestepWarning
from studies.contacts import check
from studies.truths.touching_rod import propped_reaction, rod_on_post, rod_round_cylinder

G = 9.81
LYING = RobotParams(
    "lying",
    length=0.3,
    outer_radius=0.01,
    inner_radius=0.0,
    youngs_modulus=5e5,
    density=1000.0,
    damping_time=0.02,
    pieces=12,
    gravity=(0.0, 0.0, -G),
    base=Base((0.0, 0.0, 0.05), (1.0, 0.0, 0.0)),
)
POST = Cylinder(
    name="post", radius=0.03, length=0.2, turn=(pi / 2, 0.0, 0.0), position=(0.15, 0.0, 0.35)
)
GROUND = Ground(name="ground")
SMOOTH = Contacts(friction=0.0)


def moved(config, periods, u=None):
    simulation = Simulation(build_scene(config))
    simulation.reset(simulation.model.qpos0, np.zeros(simulation.model.nu))
    if u is not None:
        simulation.ctrl[:] = u
    for _ in range(periods):
        assert simulation.advance(), simulation.failure()
    return simulation


# --- scenes without contacts ------------------------------------------------------------------


def test_only_pairs_collide():
    """Nothing that is drawn, nor the skin by itself."""
    config = replace(visible(SceneConfig(ARM)), contacts=Contacts(), objects=(POST, GROUND))
    model = build_scene(config).model
    assert not model.geom_contype.any() and not model.geom_conaffinity.any()
    touching = {*model.pair_geom1, *model.pair_geom2}
    names = {model.geom(geom).name for geom in touching}
    assert all(name.startswith("skin") or name.endswith("_shape") for name in names)


def test_contacts_leave_the_robot_as_it_is():
    """Far from everything it moves as an implicitfast scene of the same timestep does."""
    far = (replace(POST, position=(9.0, 0.0, 0.0)),)
    touching = build_scene(SceneConfig(ARM, pieces=6, contacts=Contacts(), objects=far))
    step = touching.timestep.timestep
    plain = build_scene(SceneConfig(ARM, integrator="implicitfast", timestep=step))
    u = np.array([5.0, 0, 0, 3.0, 0, 0])
    one, other = (scene.simulate(0.3, u).q[-1] for scene in (touching, plain))
    np.testing.assert_allclose(one, other, atol=1e-12)


# --- exact solutions --------------------------------------------------------------------------


def test_the_propped_cantilever_of_textbooks():
    """R = 3/8 q L at the tip, and none of a prop that gives way altogether."""
    assert propped_reaction(0.3, 0.2, 0.7, 0.3) == pytest.approx(3 / 8 * 0.7 * 0.3)
    assert propped_reaction(0.3, 0.2, 0.7, 0.3, 1e9) < 1e-9


def test_a_rod_on_a_post_is_the_beam_where_it_bends_little():
    """Hinged at the post at a: P = F (3 L - a) / (2 a) of the propped beam with an end load."""
    force, length, at = 1e-6, 0.4, 0.2
    found = rod_on_post(length, 1e-3, (force, 0.0), (0.01, at), 0.01)
    assert found.pressed == pytest.approx(force * (3 * length - at) / (2 * at), rel=1e-4)


def test_forces_on_a_rod_round_a_cylinder_balance():
    """Clamp, contact and load: the tension and shear at the clamp are those of the first part."""
    found = rod_round_cylinder(0.4, 2.5e-3, (0.3, 0.0), (0.1, 0.15), 0.1)
    assert found.contact[0] < -0.3  # the clamp pulls back, too
    assert found.pressed > np.linalg.norm(found.contact)
    with pytest.raises(EquilibriumError, match="a rod on an arc"):
        rod_round_cylinder(0.4, 2.5e-3, (0.01, 0.0), (0.1, 0.15), 0.1)


@pytest.mark.parametrize(
    ("case", "pieces", "bounds"),
    [
        ("propped cantilever", 12, {"pressed_error": 1e-3, "force_error": 5e-3}),
        ("rod on post", 12, {"pressed_error": 5e-3, "tip_error": 5e-3}),
        pytest.param(
            "rod round cylinder",
            24,
            {"pressed_error": 5e-3, "force_error": 5e-3, "tip_error": 5e-3},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_chain_presses_on_things_as_the_beam(case, pieces, bounds):
    (row,) = check(case, pieces, repeats=1)
    assert all(abs(getattr(row, name)) < bound for name, bound in bounds.items())


def test_the_stiffness_is_what_was_asked_for():
    """Depth under a load along the whole length: q / k, at any timestep."""
    k = 2e4
    base = Base((0.0, 0.0, 0.01 + 1e-9), (1.0, 0.0, 0.0))
    robot = replace(LYING, base=base, gravity=(0.0, 0.0, -1.0))
    for timestep in (None, 1e-4):
        config = SceneConfig(
            robot, contacts=replace(SMOOTH, stiffness=k), objects=(GROUND,), timestep=timestep
        )
        scene = build_scene(config)
        touches = scene.contacts(State(scene.equilibrium(), np.zeros(scene.model.nv)))
        middle = [t.depth for t in touches if 0.1 < t.stations[0] < 0.2]
        assert np.mean(middle) == pytest.approx(robot.mass_per_length / k, rel=0.02)


# --- balance of forces ------------------------------------------------------------------------


@pytest.mark.parametrize(
    "thing",
    [
        Sphere(name="thing", radius=0.02, density=700.0),
        Cylinder(name="thing", radius=0.02, length=0.05, density=700.0),
        Capsule(name="thing", radius=0.02, length=0.05, density=700.0),
        Ellipsoid(name="thing", semi_axes=(0.01, 0.02, 0.03), density=700.0),
        Box(name="thing", size=(0.01, 0.02, 0.03), density=700.0),
    ],
)
def test_masses_are_those_of_mujocos_volumes(thing):
    spec = mujoco.MjSpec()
    kind = getattr(mujoco.mjtGeom, thing.geom_type)
    body = spec.worldbody.add_body()
    body.add_geom(type=kind, size=thing.geom_size, density=700.0)
    assert spec.compile().body_mass[1] == pytest.approx(thing.total_mass, rel=1e-9)


def test_a_lying_rod_and_its_clamp_carry_its_weight():
    """Contacts and the clamp's reaction, which only the chain's own joints know."""
    simulation = moved(SceneConfig(LYING, contacts=SMOOTH, objects=(GROUND,)), 400)
    touches = simulation.contacts()
    up = net_force(touches, BACKBONE)[2]
    # The part before the first hinge moves the joints by nothing, and the rest by its own weight.
    data, model = simulation.data, simulation.model
    moments = sum(_moment_at_first_hinge(data, touch.point, touch.force) for touch in touches)
    weight = sum(
        _moment_at_first_hinge(data, data.xipos[b], model.body_mass[b] * np.array([0, 0, -G]))
        for b in range(1, model.nbody)
        if model.body(b).name.startswith("link")
    )
    spring = model.jnt_stiffness[0] * data.qpos[0]
    assert 0.3 < up / (LYING.mass * G) < 1
    assert moments + weight == pytest.approx(spring, abs=1e-3 * abs(weight))


def _moment_at_first_hinge(data, point, force):
    return np.cross(point - data.xanchor[0], force) @ data.xaxis[0]


# --- friction ---------------------------------------------------------------------------------


def on_a_slope(angle, mu, periods=60):
    gravity = (G * sin(angle), 0.0, -G * cos(angle))
    box = Box(name="box", size=(0.06, 0.06, 0.03), density=800.0, position=(1.0, 0.0, 0.015))
    robot = replace(LYING, gravity=gravity)
    config = SceneConfig(robot, contacts=Contacts(friction=mu), objects=(box, GROUND))
    return moved(config, periods)


def test_a_box_slips_where_the_slope_is_the_friction():
    mu = 0.6
    critical = degrees(atan(mu))
    stays = on_a_slope(radians(critical - 0.3), mu).data.qvel[-6]
    slips = on_a_slope(radians(critical + 0.3), mu).data.qvel[-6]
    expected = 0.6 * G * (sin(radians(critical + 0.3)) - mu * cos(radians(critical + 0.3)))
    assert abs(stays) < 1e-4
    assert slips == pytest.approx(expected, rel=0.1)


# --- what touches what ------------------------------------------------------------------------


def curled(self_contact):
    robot = replace(LYING, base=None, gravity=(0.0, 0.0, 0.0), outer_radius=0.004, pieces=16)
    turns = 1.3 * 2 * pi * robot.bending_stiffness / robot.length
    load = Load("curl", robot.length, moment=(0.0, turns, 0.0), follows=True)
    return SceneConfig(robot, loads=(load,), contacts=Contacts(self_contact=self_contact))


def test_a_curled_rod_meets_itself():
    simulation = moved(curled(True), 115, [1.0])
    touches = simulation.contacts()
    assert touches
    for touch in touches:
        assert touch.first == touch.second == BACKBONE
        assert abs(touch.stations[0] - touch.stations[1]) > pi * 0.004
    np.testing.assert_allclose(net_force(touches, BACKBONE), 0)
    state = State(simulation.posture, simulation.data.qvel)
    assert not build_scene(curled(False)).contacts(state)


@pytest.mark.parametrize("name", ["hanging_trunk", "ftdcr_v4", "silicone_rod"])
def test_no_robot_touches_itself_when_straight(name):
    config = SceneConfig(
        ROBOTS[name], contacts=Contacts(self_contact=True), bending="spatial", torsion=True
    )
    assert build_scene(config).contacts() == ()


def test_the_tightest_bend_touches_nothing():
    """Neighbours are left out that overlap even if the robot bends as far as it can."""
    robot = replace(LYING, base=None)
    scene = build_scene(SceneConfig(robot, contacts=Contacts(self_contact=True)))
    q = np.full(scene.model.nq, 0.0)
    near = scene.layout.stations < 2.0 * robot.outer_radius
    q[near] = scene.layout.weights[near] * robot.curvature_limit
    assert scene.contacts(State(q, np.zeros_like(q))) == ()


def test_parts_of_a_robot_touch_under_their_names():
    trunk = ROBOTS["ftdcr_v4"]
    x, y, z = trunk.base.position if trunk.base else (0.0, 0.0, 0.0)
    along = trunk.base.axes[:, 2] if trunk.base else np.array([0, 0, 1.0])
    disc = trunk.discs[3]
    where = np.array([x, y, z]) + along * disc.station + [disc.cylinder[0] + 0.0099, 0, 0]
    ball = Sphere(name="ball", radius=0.01, position=tuple(where))
    config = SceneConfig(trunk, bending="spatial", contacts=Contacts(), objects=(ball,))
    touches = build_scene(config).contacts()
    assert {(t.first, t.second) for t in touches} == {("disc3", "ball")}
    assert touches[0].stations == (pytest.approx(disc.station), None)


def test_a_head_touches_and_a_taper_is_as_thick_as_it_is():
    sections = (Section(0.2, (0.03, 0.01), 1e6, 1000.0, 0.02, 6),)
    robot = replace(LYING, base=None).with_sections(*sections)
    for station, radius in ((0.05, 0.025), (0.15, 0.015)):
        reach = radius + 0.02
        ball = Sphere(name="ball", radius=0.02, position=(reach, 0.0, station))
        scene = build_scene(SceneConfig(robot, contacts=Contacts(), objects=(ball,)))
        assert all(abs(t.depth) < 1.5e-3 for t in scene.contacts())
        near = replace(ball, position=(reach - 2e-3, 0.0, station))
        scene = build_scene(SceneConfig(robot, contacts=Contacts(), objects=(near,)))
        assert max(t.depth for t in scene.contacts()) == pytest.approx(2e-3, abs=1e-3)
    rig = ROBOTS["rig_equivalent"]
    top = rig.length + rig.head.centre + rig.head.half_sizes[2]
    ball = Sphere(name="ball", radius=0.02, position=(0.0, 0.0, top + 0.0199))
    scene = build_scene(SceneConfig(rig, contacts=Contacts(), objects=(ball,), bending="spatial"))
    (touch,) = scene.contacts()
    assert touch.first == "head" and touch.force[2] < 0


# --- the solver -------------------------------------------------------------------------------


def lying_on_the_ground():
    return SceneConfig(LYING, pieces=24, bending="spatial", contacts=Contacts(), objects=(GROUND,))


@pytest.mark.skipif(mujoco.mj_version() < 4_000_001, reason="needs MuJoCo's core 4.0.1")
def test_sparse_matrices_give_what_dense_ones_give():
    """MuJoCo takes them above 60 DOFs; those of 4.0.0 were wrong by what was computed."""
    ends = []
    for jacobian in (mujoco.mjtJacobian.mjJAC_DENSE, mujoco.mjtJacobian.mjJAC_AUTO):
        simulation = Simulation(build_scene(lying_on_the_ground()))
        assert simulation.model.nv > 60
        assert simulation.model.opt.jacobian == mujoco.mjtJacobian.mjJAC_AUTO
        simulation.model.opt.jacobian = jacobian
        simulation.reset(simulation.model.qpos0, np.zeros(simulation.model.nu))
        for _ in range(20):
            assert simulation.advance(), simulation.failure()
        assert simulation.contacts()
        ends.append(simulation.data.qpos.copy())
    assert np.abs(ends[1]).max() > 0
    np.testing.assert_allclose(*ends, atol=1e-9)


def test_dense_matrices_and_a_warning_where_sparse_ones_are_wrong(monkeypatch):
    monkeypatch.setattr(mujoco, "mj_version", lambda: 4_000_000)
    with pytest.warns(UserWarning, match="mujoco-core==4.0.1"):
        model = build_scene(lying_on_the_ground()).model
    assert model.opt.jacobian == mujoco.mjtJacobian.mjJAC_DENSE


# --- read-outs, choices and refusals ----------------------------------------------------------


def test_free_objects_leave_the_robots_read_outs_alone():
    ball = Sphere(name="ball", radius=0.03, density=700.0, position=(1.0, 0.0, 0.03))
    config = SceneConfig(
        LYING, pieces=12, sensors=(TipSensors(),), contacts=Contacts(), objects=(ball, GROUND)
    )
    scene = build_scene(config)
    plain = build_scene(replace(config, contacts=None, objects=(), integrator="implicitfast"))
    assert scene.model.nv == plain.model.nv + 6
    q = np.concatenate([0.1 * np.arange(plain.model.nq), scene.model.qpos0[-7:]])
    bent = q[: plain.model.nq]
    np.testing.assert_allclose(scene.tip(q), plain.tip(bent))
    np.testing.assert_allclose(scene.curvature(q), plain.curvature(bent))
    np.testing.assert_allclose(joint_angles(scene.model, q), joint_angles(plain.model, bent))
    assert scene.timestep.first_period == pytest.approx(plain.timestep.first_period)


def test_reading_contacts_moves_nothing():
    config = SceneConfig(LYING, contacts=Contacts(), objects=(GROUND,))
    read, unread = (Simulation(build_scene(config)) for _ in range(2))
    for simulation in (read, unread):
        simulation.reset(simulation.model.qpos0, np.zeros(0))
        for _ in range(30):
            simulation.advance()
            if simulation is read:
                simulation.contacts()
    assert np.array_equal(read.data.qpos, unread.data.qpos)
    again = pickle.loads(pickle.dumps(read))
    assert len(again.contacts()) == len(read.contacts())


def test_an_exported_scene_steps_as_the_scene_does():
    ball = Sphere(name="ball", radius=0.03, density=700.0, position=(0.2, 0.0, 0.02))
    config = SceneConfig(LYING, contacts=Contacts(), objects=(ball, GROUND))
    scene, model = build_scene(config), mujoco.MjModel.from_xml_string(scene_xml(config))
    found = []
    for m in (scene.model, model):
        data = mujoco.MjData(m)
        mujoco.mj_step(m, data, 400)
        assert data.ncon
        found.append(data.qpos.copy())
    np.testing.assert_allclose(*found, atol=1e-5)


def test_varied_scenes_have_contacts_for_their_own_masses():
    scene = build_scene(SceneConfig(ARM, contacts=Contacts(stiffness=1e5), objects=(POST,)))
    heavy = vary_scene(scene, {"density": 2.0})
    assert heavy.timestep.timestep == scene.timestep.timestep
    # The same stiffness of a body twice as heavy: half the frequency's square where d is the same.
    assert not np.allclose(heavy.model.pair_solref, scene.model.pair_solref)


ON_POST = SceneConfig(ARM, pieces=6, contacts=Contacts(stiffness=1e5), objects=(POST,))


def test_the_rules_timestep_follows_the_stiffness():
    soft, hard = (
        build_scene(replace(ON_POST, contacts=Contacts(stiffness=k))).timestep for k in (1e4, 1e8)
    )
    assert soft.integrator == hard.integrator == "implicitfast"
    assert hard.timestep < soft.timestep
    material = build_scene(
        SceneConfig(ROBOTS["ftdcr_v4"], bending="spatial", contacts=Contacts(), objects=(POST,))
    )
    assert "times the material's stiffness" in material.timestep.reason


def test_too_long_a_timestep_is_reported():
    with pytest.warns(TimestepWarning, match="contacts may be inaccurate"):
        build_scene(replace(ON_POST, timestep=5e-3))


def test_what_does_not_come_to_rest_is_reported(monkeypatch):
    monkeypatch.setattr(statics, "_PATIENCE", 5)
    ball = Sphere(name="ball", radius=0.03, density=700.0, position=(1.0, 0.0, 0.5))
    scene = build_scene(SceneConfig(LYING, contacts=SMOOTH, objects=(ball,)))
    with pytest.raises(EquilibriumError, match="did not come to rest"):
        scene.equilibrium()
