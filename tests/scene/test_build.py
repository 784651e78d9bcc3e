"""The compiled model against the robot's parameters, and parts that must change nothing."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.postures import posed

from softrobot_env.core.files import assets_dir
from softrobot_env.robots import ARM, find_robot
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.scene.build import build_scene, scene_xml
from softrobot_env.scene.config import (
    Appearance,
    Camera,
    Load,
    Marker,
    PathMarker,
    SceneConfig,
    TipSensors,
    attachable,
    visible,
)
from softrobot_env.scene.registry import SCENES, scene_of

FITTING = {"midpoint": 6, "gauss2": 6, "balanced2": 6, "chord2": 6, "gauss3": 3, "coupled2": 6}

GUIDED = replace(
    ARM, tendons=tuple(replace(t, guides=tuple(np.arange(0.05, t.end, 0.05))) for t in ARM.tendons)
)


def scene(robot=ARM, rule="balanced2", **options):
    return build_scene(SceneConfig(robot, pieces=FITTING[rule], rule=rule, **options))


def test_control_only_scene_contains_nothing_else():
    model = scene().model
    for part in ("ngeom", "ncam", "nlight", "nsensor", "neq", "nexclude", "npair", "nmocap"):
        assert getattr(model, part) == 0, part
    assert model.nsite == 1
    assert model.nbody == 1 + 12
    assert model.nu == model.ntendon == len(ARM.tendons)
    data = posed(model, np.full(12, 0.2))
    assert data.nefc == 0
    assert data.ncon == 0


def test_only_friction_brings_constraints():
    """One per tendon that rubs; drawn lines rub nobody."""
    robot = replace(ARM, tendons=(replace(ARM.tendons[0], friction=2.0), *ARM.tendons[1:]))
    for rubbing in (robot, ARM.vary(tendon_friction=2.0), GUIDED.vary(tendon_friction=2.0)):
        model = scene(rubbing, appearance=Appearance()).model
        friction = [t.friction for t in rubbing.tendons]
        for k, tendon in enumerate(rubbing.tendons):
            assert model.tendon_frictionloss[model.tendon(tendon.name).id] == friction[k]
        assert model.tendon_frictionloss.sum() == sum(friction)
        data = posed(model, np.full(12, 0.2))
        assert data.nefc == data.nf == np.count_nonzero(friction)
        assert data.ncon == 0


def trajectory(config):
    """Postures of a fast motion under changing tensions."""
    model = build_scene(config).model
    data, tendon_map = mujoco.MjData(model), TendonMap(config.robot)
    postures = []
    for k in range(30):
        inputs = 30 * np.sin([0.2 * k, 0.3 * k, 0.5 * k])
        data.ctrl[: len(config.robot.tendons)] = tendon_map.tension(inputs)
        mujoco.mj_step(model, data, 5)
        postures.append(np.concatenate((data.qpos, data.qvel)))
    return np.array(postures)


DECORATION = {
    "appearance": {"appearance": Appearance()},
    "marker": {"markers": (Marker("ball", (0.1, 0.0, 0.3)),)},
    "path": {"paths": (PathMarker("line", ((0.0, 0.0, 0.1), (0.2, 0.0, 0.4))),)},
    "camera": {"cameras": (Camera("front", (0.0, 0.25), 0.9),)},
    "sensors": {"sensors": (TipSensors(),)},
    "unused_load": {"loads": (Load("push", 0.4, force=(1.0, 0.0, 0.0)),)},
}


@pytest.fixture(scope="module")
def bare_motion():
    motion = trajectory(SceneConfig(GUIDED))
    assert np.ptp(motion) > 1  # it does move
    return motion


@pytest.mark.parametrize("part", DECORATION)
def test_optional_parts_change_no_bit_of_the_motion(bare_motion, part):
    found = trajectory(SceneConfig(GUIDED, **DECORATION[part]))
    np.testing.assert_array_equal(found, bare_motion)


@pytest.mark.parametrize("name", ["implicitfast", "discrete", "implicit", "Euler", "RK4"])
def test_integrator_and_timestep_asked_for_are_compiled(name):
    model = build_scene(SceneConfig(ARM, integrator=name, timestep=5e-5)).model
    assert model.opt.integrator == getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}")
    assert model.opt.timestep == pytest.approx(5e-5, rel=1e-12)


# ----------------------------------------------------------------


#: Numbers in MJCF have six digits: half a unit of the last one, relative to 1.00000.
PRECISION = 5e-6


def exported(name):
    """The scene in a file of assets/."""
    scene = SCENES[name]
    return attachable(scene) if scene.appearance is None else scene


@pytest.mark.parametrize("name", SCENES)
def test_exported_scene_is_what_the_builder_makes(name):
    text = (assets_dir() / f"{name}.xml").read_text(encoding="utf-8")
    assert text == scene_xml(exported(name)), "run: softrobot export --out assets --overwrite"


@pytest.mark.parametrize("name", SCENES)
def test_exported_scene_compiles_to_the_same_model(name):
    loaded = mujoco.MjModel.from_xml_path(str(assets_dir() / f"{name}.xml"))
    built = build_scene(exported(name)).model
    assert (loaded.nv, loaded.nu, loaded.ntendon) == (built.nv, built.nu, built.ntendon)
    for field in ("body_mass", "body_inertia", "body_pos", "jnt_stiffness", "dof_damping"):
        expected = getattr(built, field)
        np.testing.assert_allclose(getattr(loaded, field), expected, rtol=PRECISION, err_msg=field)
    assert loaded.opt.timestep == pytest.approx(built.opt.timestep, rel=PRECISION)
    assert loaded.opt.integrator == built.opt.integrator
    assert loaded.opt.disableflags == built.opt.disableflags


WORLD = """
<mujoco>
  <option timestep="5e-4" integrator="implicitfast" gravity="0 0 -9.81"/>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="cart" pos="0.1 0.2 1.3" euler="10 20 130">
      <joint/>
      <geom size=".03" mass="1"/>
      <site name="mount" pos="0.01 0.02 0.03" euler="90 30 0"/>
    </body>
  </worldbody>
</mujoco>"""


@pytest.mark.parametrize("name", ["hanging_trunk", "silicone_rod", "ftdcr_v4", "arm", "rig"])
def test_an_exported_robot_lands_on_its_mount(name):
    world = mujoco.MjSpec.from_string(WORLD)
    places = {"a/": world.site("mount"), "b/": world.worldbody.add_site(name="wall", pos=[0, 0, 1])}
    text = scene_xml(attachable(scene_of(find_robot(name))))
    for prefix, site in places.items():
        robot = mujoco.MjSpec.from_string(text)
        robot.option.timestep, robot.option.gravity = world.option.timestep, world.option.gravity
        world.attach(robot, prefix=prefix, site=site)
    model = world.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert not model.opt.disableflags and model.nu == 2 * len(find_robot(name).tendons)
    for prefix, site in places.items():
        base, mount = data.body(f"{prefix}base"), data.site(site.name)
        np.testing.assert_array_equal(base.xpos, mount.xpos)
        np.testing.assert_array_equal(base.xmat, mount.xmat)
        assert model.skin(f"{prefix}soft_body").id >= 0
    owners = [model.body(i).name for i in model.geom_bodyid]
    seen = np.array([name.startswith(tuple(places)) for name in owners])
    assert seen.any() and not model.geom_contype[seen].any()
    assert not model.geom_conaffinity[seen].any()


@pytest.mark.parametrize("name", ["hanging_trunk", "rig"])
def test_an_exported_robot_moves_as_its_scene(name):
    """Seen from its base, whatever is shown of it."""
    config = scene_of(find_robot(name))
    robot, tips = config.robot, []
    for seen in (config, attachable(config)):
        model = mujoco.MjModel.from_xml_string(scene_xml(seen))
        data, shares = mujoco.MjData(model), np.random.default_rng(3).uniform(0, 0.4, model.nu)
        data.ctrl = shares * model.actuator_ctrlrange[:, 1]
        path = []
        for _ in range(200):
            mujoco.mj_step(model, data)
            path.append(data.site("tip").xpos.copy())
        base = seen.robot.clamp
        tips.append((np.array(path) - base.position) @ base.axes)
    assert np.ptp(tips[0], axis=0).max() > 0.01 * robot.length
    np.testing.assert_allclose(tips[1], tips[0], atol=1e-9 * robot.length)


INSIDE = {
    "helix": {"offset": (0.012, 0.0), "turns": 0.7},
    "guides": {"offset": (0.012, 0.0), "guides": (0.1, 0.2, 0.3)},
    "via": {"offset": (0.03, 0.0), "route": ((0.2, 0.0, 0.01), (0.5, -0.01, 0.0))},
}


@pytest.mark.parametrize("changes", INSIDE.values(), ids=INSIDE)
def test_tendons_inside_are_shown_on_the_surface(changes):
    tendon = replace(ARM.tendons[0], end=0.5, **changes)
    robot = replace(ARM, tendons=(tendon,))
    model = build_scene(visible(scene_of(robot))).model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    drawn = [
        model.tendon(i).name
        for i in np.flatnonzero(model.tendon_rgba[:, 3])
        if model.wrap_type[model.tendon_adr[i]] == mujoco.mjtWrap.mjWRAP_SITE
    ]
    assert drawn == [f"{tendon.name}_line"]
    number = model.tendon(drawn[0]).id
    first, count = model.tendon_adr[number], model.tendon_num[number]
    points = data.site_xpos[model.wrap_objid[first : first + count]]
    points = np.vstack([points, (points[1:] + points[:-1]) / 2])  # of its chords too
    outside = np.hypot(*points[:, :2].T) - robot.backbone.outer_radius(points[:, 2])
    assert outside.min() > 0 and points[:, 2].max() == pytest.approx(0.5)


def test_no_stray_assets():
    assert {path.stem for path in assets_dir().glob("*.xml")} == set(SCENES)
