"""A failed simulation is reported, never hidden."""

from dataclasses import replace

import gymnasium
import mujoco
import numpy as np
import pytest
from support.episodes import pumping, steps

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.envs.rewards import TERMS
from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import ARM
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.timestep import TimestepWarning, linearize
from softrobot_env.tasks import make_task

FULL = np.ones(3, np.float32)
ZERO = np.zeros(3, np.float32)


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """MuJoCo writes its log of warnings into the working directory."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def unstable(make_env):
    """Environment whose explicit steps are far too long for an undamped arm."""
    robot = replace(ARM, damping_time=0.0, name="undamped")
    task = replace(make_task("swing"), robot=robot)
    with pytest.warns(TimestepWarning, match=r"RK4 is beyond the stability limit"):
        return make_env(
            task=task, integrator="RK4", timestep=0.02, control_period=0.02, observe="all"
        )


@pytest.fixture
def env(make_env):
    env = make_env(observe="all")
    env.reset()
    return env


def check_failed(env, results, start, text):
    """The contract of a failed step."""
    observation, reward, terminated, truncated, info = results[-1]
    assert (terminated, truncated) == (True, False)
    assert text in info["failure"] and np.isfinite(info["time"])
    assert f"t = {info['time']:.3f} s" in info["failure"]
    assert reward == -10
    assert [info[name] for name in TERMS] == [0, 0, 0, 0, -10]
    assert env.observation_space.contains(observation)
    assert all(np.all(np.isfinite(v)) for v in observation.values())
    before = results[-2][0] if len(results) > 1 else start
    for name, value in before.items():
        np.testing.assert_array_equal(observation[name], value)
    assert all("failure" not in r[4] for r in results[:-1])
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(ZERO)


@pytest.mark.parametrize("kick", [0.0, 1e12])
def test_an_unstable_integration_never_passes_for_a_success(unstable, kick):
    """Left alone it leaves the workspace or diverges, whichever comes first."""
    start, _ = unstable.reset()
    unstable.data.qvel[:] = kick  # beyond what MuJoCo accepts (1e10), or nothing
    results = list(steps(unstable, lambda *_: FULL))
    failure = results[-1][4]["failure"]
    check_failed(unstable, results, start, failure[:10])
    assert failure.startswith(("simulation diverged", "left the workspace"))
    if kick:
        assert failure.startswith("simulation diverged") and "RK4" in failure and "0.02" in failure
    assert len(results) < 750


#: Ways to integrate; other beam models take long to compile.
SOLVERS = {
    "extrapolation": ({}, ()),
    "implicitfast": ({"integrator": "implicitfast"}, ()),
    "discrete": ({"integrator": "discrete"}, ()),
    "RK4": ({"integrator": "RK4", "timestep": 5e-5}, ()),
    "pcc": ({"plant": BeamPlant("pcc")}, ()),
    "cosserat": ({"plant": BeamPlant("cosserat")}, pytest.mark.slow),
    "ancf": ({"plant": BeamPlant("ancf")}, pytest.mark.slow),
}


@pytest.mark.parametrize("which", [0, 1], ids=["posture", "velocity"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -1e300])
@pytest.mark.parametrize(
    "options", [pytest.param(way, marks=marks, id=name) for name, (way, marks) in SOLVERS.items()]
)
def test_a_broken_state_is_reported_at_once(which, value, options, make_env):
    env = make_env(observe="all", **options)
    env.reset()
    last = [env.step(ZERO) for _ in range(3)]
    is_beam = env.data is None
    state = env.simulation if is_beam else env.data
    getattr(state, (("q", "v") if is_beam else ("qpos", "qvel"))[which])[2] = value
    results = [*last, env.step(ZERO)]
    check_failed(env, results, None, "simulation diverged")
    info = results[-1][4]
    assert np.isnan(info["error"]) and np.all(np.isfinite(info["tendon_tension"]))
    assert info["time"] == pytest.approx(0.04, abs=1e-9)
    if is_beam:
        assert "sdirk4" in info["failure"]
    else:
        # A reset behind our back, which MuJoCo would do, would have set time and state to zero.
        assert env.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_AUTORESET
        assert env.data.time == pytest.approx(0.04, abs=1e-9) and env.data.qpos.any()
    assert "failure" not in env.reset()[1]


def test_a_broken_force_is_reported(env):
    """The state is still fine when the acceleration is not."""
    start, _ = env.reset()
    env.data.qfrc_applied[:] = 1e300
    check_failed(env, [env.step(ZERO)], start, "simulation diverged")


def test_leaving_the_workspace_ends_the_episode(env):
    """Pumping in step with the motion bends a piece beyond 1 / outer radius."""
    start, _ = env.reset()
    results = list(steps(env, pumping))
    check_failed(env, results, start, "left the workspace")
    failure = results[-1][4]["failure"]
    curvature = np.array([env.data.qpos[2 * k : 2 * k + 2].sum() * 12 for k in range(6)])
    piece = int(np.argmax(np.abs(curvature)))
    assert abs(curvature[piece]) > 40
    assert f"{curvature[piece]:.4g} 1/m of piece {piece + 1}" in failure
    assert "40 1/m" in failure
    assert all(np.abs(r[0]["curvature"]).max() <= 40 for r in results)


@pytest.mark.parametrize(("bend", "over"), [(39.9, False), (40.1, True)])
@pytest.mark.parametrize("piece", [0, 3, 5])
def test_the_limit_is_that_of_one_piece(bend, over, piece, make_env):
    """One bent piece in a straight arm, held by generalised forces that balance its springs."""
    env = make_env(control_period=1e-3)
    env.reset(options={"start_input": [0.0, 0.0, 0.0]})
    env.data.qpos[:] = 0
    env.data.qpos[2 * piece : 2 * piece + 2] = bend / 24
    env.data.qfrc_applied[:] = env.model.jnt_stiffness * env.data.qpos
    mujoco.mj_forward(env.model, env.data)
    *_, terminated, _, info = env.step(ZERO)
    assert terminated == over
    assert ("failure" in info) == over
    if over:
        assert f"of piece {piece + 1}" in info["failure"]


# A control period of many swings.
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
def test_failure_in_the_last_step_is_a_failure(make_env):
    env = make_env("SoftRobot/ArmStep-v0", control_period=0.2)
    env.reset()
    for _ in range(24):
        env.step(ZERO)
    env.data.qpos[0] = np.nan
    *_, terminated, truncated, info = env.step(ZERO)
    assert (terminated, truncated) == (True, False)
    assert "failure" in info


#: [rad/s2], beyond MuJoCo's bound of 1e10; after a step of 10 ms the velocity is within it.
ACCELERATION = 3e10

STEP = {"timestep": 0.01, "control_period": 0.01, "integrator": "implicitfast"}


def raised(warning):
    """Numbers of warnings of position, velocity and acceleration."""
    kinds = mujoco.mjtWarning
    return [
        int(warning[int(kind)])
        for kind in (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
    ]


def test_a_huge_acceleration_ends_an_episode():
    env = TrackingEnv("swing", **STEP)
    env.reset()
    mass = linearize(env.model).mass
    env.data.qfrc_applied[:] = mass @ np.full(env.model.nv, ACCELERATION)
    *_, terminated, _, info = env.step(np.zeros(3, np.float32))
    assert raised(env.data.warning.number) == [0, 0, 1]
    assert terminated and "acceleration of DOF" in info["failure"]


def test_a_huge_acceleration_ends_one_of_many():
    """Springs drive it, from a posture that is within the bound."""
    scene = build_scene(SceneConfig(ARM, **STEP))
    chain = linearize(scene.model)
    posture = np.linalg.solve(chain.stiffness, chain.mass @ np.full(len(chain.mass), ACCELERATION))
    assert np.abs(posture).max() < 1e10
    alone = mujoco.MjData(scene.model)
    alone.qpos[:] = posture
    mujoco.mj_step(scene.model, alone)
    mujoco.mj_step1(scene.model, alone)
    assert raised(alone.warning.number) == [0, 0, 1]

    batch = BatchSimulation(scene, 3)
    postures = np.stack([0 * posture, posture, 0 * posture])
    batch.reset(np.arange(3), postures, np.zeros((3, scene.model.nu)))
    assert batch.advance().tolist() == [False, True, False]
