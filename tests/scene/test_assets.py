import mujoco
import numpy as np
import pytest

from softrobot_env.core.paths import assets_dir
from softrobot_env.scene.build import build_scene, scene_xml
from softrobot_env.scene.registry import SCENES

#: Numbers in MJCF have six digits: half a unit of the last one, relative to 1.00000.
PRECISION = 5e-6


@pytest.mark.parametrize("name", SCENES)
def test_exported_scene_is_what_the_builder_makes(name):
    text = (assets_dir() / f"{name}.xml").read_text(encoding="utf-8")
    assert text == scene_xml(SCENES[name]), "run: softrobot export --out assets --overwrite"


@pytest.mark.parametrize("name", SCENES)
def test_exported_scene_compiles_to_the_same_model(name):
    loaded = mujoco.MjModel.from_xml_path(str(assets_dir() / f"{name}.xml"))
    built = build_scene(SCENES[name]).model
    assert (loaded.nv, loaded.nu, loaded.ntendon) == (built.nv, built.nu, built.ntendon)
    for field in ("body_mass", "body_inertia", "body_pos", "jnt_stiffness", "dof_damping"):
        expected = getattr(built, field)
        np.testing.assert_allclose(getattr(loaded, field), expected, rtol=PRECISION, err_msg=field)
    assert loaded.opt.timestep == pytest.approx(built.opt.timestep, rel=PRECISION)
    assert loaded.opt.integrator == built.opt.integrator
    assert loaded.opt.disableflags == built.opt.disableflags


def test_no_stray_assets():
    assert {path.stem for path in assets_dir().glob("*.xml")} == set(SCENES)


def test_environments_simulate_the_registered_scene():
    from softrobot_env.envs.tracking import TrackingEnv

    env = TrackingEnv("swing")
    assert env.scene.config == SCENES["arm"]
