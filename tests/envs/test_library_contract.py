"""What learning libraries rely on, of every registered environment: single, vectorised, real."""

import copy
import pickle
from contextlib import closing, contextmanager
from functools import partial
from math import ceil

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from support.episodes import pumping, steps, switching
from support.example_robots import EVERY_ROBOT
from support.processes import in_a_fork
from support.real_episodes import live_rig
from support.rig_episodes import flatten

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.rewards import TERMS
from softrobot_env.registration import (
    ANY_ROBOT,
    ENVIRONMENTS,
    GRIPPER_ENVIRONMENTS,
    REAL_ENVIRONMENTS,
    RIG_ENVIRONMENTS,
)

SIMULATED = [*ENVIRONMENTS, *RIG_ENVIRONMENTS, *ANY_ROBOT]
REAL = [pytest.param(i, marks=pytest.mark.realtime(late=0.4)) for i in REAL_ENVIRONMENTS]


@contextmanager
def made(env_id, **options):
    """An environment by its id; a real one with a board in memory that needs no clock."""
    if env_id not in REAL_ENVIRONMENTS:
        with closing(gymnasium.make(env_id, **options)) as env:
            yield env
        return
    with live_rig(partial(gymnasium.make, env_id), **options) as env:
        yield env


def infos(env, steps=5):
    """`info` of a reset and of some steps."""
    yield env.reset(seed=0)[1]
    for _ in range(steps):
        yield env.step(np.zeros(env.action_space.shape, np.float32))[4]


def assert_flat(info):
    for name, value in info.items():
        if isinstance(value, np.ndarray):
            assert value.dtype == np.float64, name
        else:
            assert type(value) in (np.float64, str, bool), name


# ---------------------------------------------------------------- info


@pytest.mark.parametrize("env_id", [*SIMULATED, *REAL])
def test_info_is_flat_with_the_same_keys_at_every_step(env_id):
    with made(env_id) as env:
        reported = list(infos(env))
    for info in reported:
        assert list(info) == list(reported[0])
        assert_flat(info)
    assert set(TERMS) < set(reported[0]) and all(reported[0][name] == 0 for name in TERMS)


@pytest.mark.parametrize("observe_as", ["dict", "vector"])
@pytest.mark.parametrize("env_id", SIMULATED)
def test_a_failed_step_shows_what_was_seen_before_it_and_says_why(env_id, observe_as):
    with made(env_id, observe_as=observe_as) as env:
        last, first = env.reset()
        env.unwrapped.data.qvel[0] = np.nan
        zero = np.zeros(env.action_space.shape, np.float32)
        observation, _, terminated, _, info = env.step(zero)
    assert observation is not last and flatten(observation) == flatten(last)
    assert terminated and info.pop("failure") and list(info) == list(first)
    assert_flat(info)


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("env_id", SIMULATED)
def test_info_of_many_has_the_keys_of_one(env_id, mode):
    ranges = Randomization(density=(0.9, 1.1), sensor_noise=(1.0, 2.0))
    options = {"randomization": ranges, "control_period": 0.1}
    with made(env_id, **options) as single:
        _, one = single.reset(seed=0)
    options |= {"num_envs": 2, "max_episode_steps": 3}
    many = gymnasium.make_vec(env_id, autoreset_mode=mode, **options)
    _, first = many.reset(seed=0)
    assert {name for name in first if name[0] != "_"} == set(one)
    assert {name[1:] for name in first if name[0] == "_"} == set(one)
    last = {"final_obs", "_final_obs", "final_info", "_final_info"}
    for _ in range(3):
        *_, truncated, info = many.step(np.zeros(many.action_space.shape, np.float32))
        assert set(info) - last == set(first)
        assert all(not isinstance(v, dict) for k, v in info.items() if k not in last)
    assert truncated.all() == ("final_info" in info or mode != AutoresetMode.SAME_STEP)


# ---------------------------------------------------------------- making


@pytest.mark.parametrize("env_id", [*SIMULATED, *REAL])
def test_an_unknown_argument_is_told_as_python_does_with_those_allowed(env_id):
    message = "got an unexpected keyword argument 'frameskip'; allowed are .*control_period"
    real = env_id in REAL_ENVIRONMENTS
    for make in (gymnasium.make,) if real else (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(TypeError, match=message) as caught:
            make(env_id, frameskip=1)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("env_id", [*SIMULATED, *REAL])
def test_direct_bases_and_spec(env_id):
    with made(env_id) as env:
        assert gymnasium.Env in type(env.unwrapped).__bases__
        assert env is env.unwrapped, "no wrapper"
        steps = ceil(env.task.duration / env.control_period - 1e-9)
        assert env.spec.max_episode_steps == steps
        assert env.spec.nondeterministic == (env_id in REAL_ENVIRONMENTS)
        assert env.spec.id == env_id


@pytest.mark.parametrize("env_id", SIMULATED)
def test_many_as_gymnasium_defines_them(env_id):
    for mode in AutoresetMode:
        many = gymnasium.make_vec(env_id, num_envs=2, autoreset_mode=mode)
        assert many.metadata["autoreset_mode"] is many.autoreset_mode is mode
        again = gymnasium.make_vec(many.spec)
        assert again.autoreset_mode is mode and again.num_envs == 2
        assert again.spec.max_episode_steps == many.spec.max_episode_steps
    assert gymnasium.vector.VectorEnv in type(many).__bases__
    assert type(many).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


def test_many_end_after_max_episode_steps():
    many = gymnasium.make_vec(SIMULATED[0], num_envs=2, max_episode_steps=3)
    many.reset()
    ends = [many.step(np.zeros((2, 3)))[3].tolist() for _ in range(4)]
    assert ends == [[False, False], [False, False], [True, True], [False, False]]


# ---------------------------------------------------------------- bounds of observations

#: Light, stiff and undamped, heavy and soft: the tips are the fastest there are.
EXTREMES = (
    {"youngs_modulus": 5.0, "density": 0.1, "damping_time": 0.0},
    {"youngs_modulus": 0.2, "density": 10.0, "damping_time": 0.0},
    {"density": 0.1, "damping_time": 0.1, "tension_gain": 2.0},
    {"youngs_modulus": 50.0, "density": 0.1, "damping_time": 0.0},
)


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.parametrize("vary", EXTREMES, ids=str)
@pytest.mark.parametrize("policy", [pumping, switching])
def test_extreme_motion_stays_within_the_bounds(policy, vary):
    with made("SoftRobot/ArmSwing-v0", observe="all") as env:
        env.reset(seed=0, options={"vary": vary})
        most = 0.0
        for observation, _, failed, _, info in steps(env, policy, 60):
            assert env.observation_space.contains(observation)
            if failed:
                assert "curvature" in info["failure"]  # folded, and not too fast
                break
            share = {n: np.abs(v) / env.observation_space[n].high for n, v in observation.items()}
            most = max(most, *share["tip_velocity"], *share["curvature_rate"])
        assert most < 0.5


def test_bounds_are_of_useful_size():
    for env_id in SIMULATED:
        with made(env_id, observe="all") as env:
            space = env.observation_space
            # Sound in the material of both robots is at some 25 m/s.
            assert 100 < space["tip_velocity"].high.max() < 2000
            assert 1e4 < space["curvature_rate"].high.max() < 1e7


@pytest.mark.parametrize("env_id", ["SoftRobot/ArmSwing-v0", "SoftRobot/RigTriangle-v0"])
@pytest.mark.parametrize("what", ["tip speed", "norm of the hinge rates"])
def test_what_is_faster_than_the_bounds_is_a_failure(env_id, what):
    """Hinges that turn against each other leave the tip at rest."""
    with made(env_id, observe="all") as env:
        env.reset()
        model, data, readout = env.unwrapped.model, env.unwrapped.data, env.unwrapped._readout
        jacobian, limits = np.zeros((3, model.nv)), readout._measures
        mujoco.mj_jacSite(model, data, jacobian, None, model.site("tip").id)
        rates = np.random.default_rng(0).standard_normal(model.nv)
        unit = np.linalg.norm((jacobian @ rates)[env.unwrapped.axes]) / limits.speed
        if what != "tip speed":
            rates -= np.linalg.pinv(jacobian) @ jacobian @ rates
            unit = np.linalg.norm(rates) / limits.turning
        for factor in (0.9, 1.1):
            data.qvel[:] = rates * factor / unit
            mujoco.mj_forward(model, data)
            reported = readout.update()
            assert reported is None if factor < 1 else what in reported


def test_many_fail_by_the_same_bounds():
    many = gymnasium.make_vec("SoftRobot/ArmSwing-v0", num_envs=3, observe="all")
    many.reset()
    limits = many._exact._measures
    many.simulation.qvel[1] = 2 * limits.turning
    many._exact.update()
    assert many._exact.outside.tolist() == [False, True, False]
    assert "norm of the hinge rates" in many._exact.what_left(1, 0.0)


# ---------------------------------------------------------------- copies, processes


@pytest.mark.parametrize("way", [copy.copy, copy.deepcopy, pickle.dumps])
def test_many_are_not_copied(way):
    many = gymnasium.make_vec(SIMULATED[0], num_envs=2)
    with pytest.raises(TypeError, match="cannot be copied or pickled"):
        way(many)


def test_many_refuse_a_forked_child_and_go_on_here():
    many = gymnasium.make_vec(SIMULATED[0], num_envs=2)
    many.reset()
    zero = np.zeros((2, 3))
    reported = "RuntimeError: these simulations belong to process"
    assert in_a_fork(lambda: many.step(zero)).startswith(reported)
    assert in_a_fork(many.reset).startswith(reported)
    assert in_a_fork(many.simulation._batch._delete) == ""
    many.step(zero)


@pytest.mark.realtime(late=0.4)
def test_a_forked_child_does_not_drive_the_real_robot():
    with made(*REAL_ENVIRONMENTS) as env:
        env.reset()
        zero = np.zeros(3, np.float32)
        for act in (lambda: env.step(zero), env.reset):
            assert in_a_fork(act).startswith("RuntimeError: this robot is driven by process")
        assert env.step(zero)[4]["device_state"] == "running"


def test_one_steps_in_a_forked_child():
    with made(SIMULATED[0]) as env:
        env.reset()
        assert in_a_fork(lambda: env.step(np.zeros(3, np.float32))) == ""


# ---------------------------------------------------------------- the checkers


#: Ids and options; the real robot comes to rest before every one of many episodes.
CHECKED = [*EVERY_ROBOT.args[1], *(pytest.param(i, {}, id=i) for i in GRIPPER_ENVIRONMENTS)]
CHECKED += [
    pytest.param(i, {}, marks=[*REAL[0].marks, pytest.mark.slow], id=i) for i in REAL_ENVIRONMENTS
]
CHECKED += [pytest.param(SIMULATED[0], {"plant": BeamPlant("pcc")}, id="pcc")]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("observe_as", ["dict", "vector"])
@pytest.mark.parametrize(("env_id", "options"), CHECKED)
def test_the_checkers_have_nothing_to_say(env_id, options, observe_as):
    with made(env_id, observe="all", observe_as=observe_as, **options) as env:
        check_env(env.unwrapped, skip_render_check=True)
        sb3 = pytest.importorskip("stable_baselines3.common.env_checker", reason="needs extra rl")
        sb3.check_env(env, warn=observe_as == "vector" or env_id not in GRIPPER_ENVIRONMENTS)
