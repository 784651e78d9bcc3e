"""Robots on MuJoCo Warp against MuJoCo's C engine, on Warp's CPU device: `make test-gpu`.

Both take the same steps here: an accuracy of `ANY` lets the compiled integrator keep the length of
a step and its three rows. What is left is that Warp computes mass, forces and sensors in float32.
How much that may be is measured by the C engine itself: a third batch has its state rounded to
float32 once a control period. Warp rounds in each of its four and more evaluations of a period, and
everything that leads to a force, so `ROUNDINGS` times that difference are allowed.
"""

from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from support.routed_robots import ROD, tendon

from softrobot_env.cli import main
from softrobot_env.envs.randomization import Randomization
from softrobot_env.robots.parameters import Drive
from softrobot_env.robots.twin import nominal_twin
from studies.speed import warp_rows

torch = pytest.importorskip("torch")
pytest.importorskip("mujoco_warp")

pytestmark = [pytest.mark.gpu, pytest.mark.filterwarnings("default")]

ARM, RIG, ANY_ROBOT = "SoftRobot/ArmSwing-v0", "SoftRobot/RigTriangle-v0", "SoftRobot/Track-v0"
FILE = str(Path(__file__).resolve().parents[2] / "assets" / "robots" / "hanging_trunk.toml")

#: Measured: 6 to 35 times; the weights of the three rows, 4.5, -4 and 0.5, are a part of that.
ROUNDINGS = 60

#: Where three tendons lie [m], and robots with such: in channels that wind, in rough ones, and
#: through guides of a rod that bends and twists alike.
PLACES = ((0.008, 0.0), (-0.004, 0.007), (-0.004, -0.007))
WOUND, RUBBING, ISOTROPIC = (
    replace(
        ROD,
        name=name,
        poisson_ratio=ratio,
        tendons=tuple(tendon(f"t{k}", xy, 0.4, **how) for k, xy in enumerate(PLACES)),
    )
    for name, ratio, how in (
        ("wound", 0.45, {"turns": 0.5}),
        ("rubbing", 0.45, {"friction": 0.1}),
        ("isotropic", 0.0, {"turns": 0.5, "guides": (0.1, 0.2, 0.3)}),
    )
)

#: Accuracy [m] with which no step of the compiled integrator is divided.
ANY = 1e6

COUNT = 4


def made(env_id, **options):
    """Environments on Warp."""
    return make(env_id, backend="warp", device="cpu", **options)


def make(env_id, **options):
    options = {"num_envs": COUNT, "vectorization_mode": "vector_entry_point"} | options
    return gymnasium.make_vec(env_id, **options).unwrapped


def pair(env_id, **options):
    """The same environments on Warp and on the C engine."""
    warp = made(env_id, **options)
    return warp, alike(warp, env_id, **options)


def alike(warp, env_id, **options):
    steps = {"timestep": warp.simulation.scene.timestep.timestep}
    steps |= {} if "integrator" in options else {"accuracy": ANY}
    return make(env_id, **(steps | options))


def actions(env, steps, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, *env.action_space.shape))


def flat(reported, path="") -> dict[str, np.ndarray]:
    """All numbers and flags in an answer of `step` or `reset`, but the estimate of C's errors."""
    if isinstance(reported, dict | tuple):
        items = reported.items() if isinstance(reported, dict) else enumerate(reported)
        kept = [(k, v) for k, v in items if "integration_error" not in str(k)]
        return {n: x for key, value in kept for n, x in flat(value, f"{path}/{key}").items()}
    value = reported.numpy() if isinstance(reported, torch.Tensor) else reported
    return {} if value.dtype == object else {path: value}


def differences(one, other) -> dict[str, float]:
    """Largest difference of each quantity; flags must be equal."""
    one, other = flat(one), flat(other)
    assert one.keys() == other.keys()
    found = {}
    for name, value in one.items():
        assert (value.shape, value.dtype) == (other[name].shape, other[name].dtype), name
        if value.dtype == bool:
            np.testing.assert_array_equal(value, other[name], err_msg=name)
        else:
            found[name] = float(np.abs(value - other[name]).max())
    return found


def largest(one, other):
    return {name: max(one.get(name, 0.0), value) for name, value in other.items()}


def stepped(off, envs, steps, size=1.0):
    """Largest differences so far, and those of more steps of both."""
    for action in size * actions(envs[1], steps):
        off = largest(off, differences(*(env.step(action) for env in envs)))
    return off


# ---------------------------------------------------------------- 500 steps


@pytest.mark.parametrize(
    ("env_id", "options", "most"),
    [
        (ARM, {}, 5e-6),
        (ARM, {"integrator": "implicitfast"}, 5e-6),
        (ARM, {"integrator": "discrete"}, 5e-6),
        (RIG, {}, 5e-7),
        (RIG, {"twin": 3}, 5e-7),
        (ANY_ROBOT, {"robot": FILE}, 5e-6),
    ],
    ids=["arm", "arm, implicitfast", "arm, discrete", "rig", "twin", "file"],
)
def test_500_steps_differ_by_roundings(env_id, options, most):
    """`most` [m] is what the tips may differ."""
    options = options | {"observe": "all", "max_episode_steps": 10**6}
    warp, exact = pair(env_id, **options)
    rounded = alike(warp, env_id, **options)
    for env in (warp, exact, rounded):
        env.reset(seed=1)
    off, noise, fastest = {}, {}, 0.0
    for action in actions(exact, 500):
        for name in ("qpos", "qvel"):
            state = getattr(rounded.simulation, name)
            state[:] = state.astype(np.float32)
        truth = exact.step(action)
        fastest = max(fastest, np.abs(truth[0]["curvature_rate"]).max())
        off = largest(off, differences(warp.step(torch.tensor(action)), truth))
        noise = largest(noise, differences(rounded.step(action), truth))
    tip = "/0/tip_position"
    reported = ", ".join(
        f"{n[3:]} {off[n]:.1e} ({noise[n]:.1e})" for n in off if n.startswith("/0")
    )
    print(f"{env_id} {options}: {reported}; reward {off['/1']:.1e} ({noise['/1']:.1e})")
    assert 0 < off[tip] < most
    for name in (tip, "/0/tip_velocity", "/0/curvature", "/1"):
        assert off[name] < ROUNDINGS * noise[name], name
    # What forces are rounded by moves the stiffest modes most, which the tip does not see.
    assert off["/0/curvature_rate"] < 1e-5 * fastest


def test_steps_of_one_length_keep_the_usual_accuracy():
    for env_id in (ARM, RIG):
        warp, usual = made(env_id), make(env_id)
        wanted = usual.simulation.scene.timestep.accuracy
        for env in (warp, usual):
            env.reset(seed=1)
        off = 0.0
        for action in actions(usual, 100):
            tips = [env.step(action)[0]["tip_position"] for env in (warp, usual)]
            off = max(off, float(np.linalg.norm(tips[0].numpy() - tips[1], axis=1).max()))
        assert off < wanted


# ---------------------------------------------------------------- episodes

EVERYTHING = Randomization(
    youngs_modulus=(0.5, 1.5),
    density=(0.6, 1.5),
    damping_time=(0.5, 2.0),
    tendon_radius=(0.9, 1.1),
    tension_gain=(0.9, 1.1),
    tendon_friction=(0.0, 0.5),
    delay=(0.0, 0.03),
    sensor_noise=(0.0, 1.0),
)
ALL_BUT_GAIN = Randomization(**{n: v for n, v in EVERYTHING.varied.items() if n != "tension_gain"})

#: Curvature sensors of a specimen that is drawn for every episode.
SENSED = {
    "robot": "gripper_finger",
    "task": "reach",
    "observe": ("all", "sensors"),
    "randomization": Randomization(sensor_errors=(0.0, 1.0)),
}

#: Exact channels that wind, and servos that err.
DRIVEN = replace(WOUND, drive=Drive("length", speed=0.05))
ERRING = replace(nominal_twin(DRIVEN), backlash=(2e-4,) * 3, servo_offset=(1e-4, 0.0, -1e-4))


@pytest.mark.parametrize(
    ("env_id", "options"),
    [
        (ARM, {"randomization": EVERYTHING}),
        (ARM, {"randomization": EVERYTHING, "autoreset_mode": "SameStep", "observe_as": "vector"}),
        ("SoftRobot/RigReach-v0", {"randomization": ALL_BUT_GAIN}),
        (ANY_ROBOT, {"robot": FILE, "randomization": EVERYTHING}),
        (ANY_ROBOT, {"robot": "ftdcr_v4", "randomization": ALL_BUT_GAIN}),
        ("SoftRobot/ArmRandom-v0", {"reward": "log", "act_as": "change"}),
        (RIG, {"twin": 3, "randomization": Randomization(sensor_noise=(0.0, 1.0))}),
        (ANY_ROBOT, SENSED),
    ],
    ids=["arm", "vector, same step", "rig", "file", "guides", "drawn tasks", "twin", "sensors"],
)
def test_episodes_are_those_of_the_c_engine(env_id, options):
    """Draws, resets within steps, rewards, flags and `info`, all of them."""
    warp, exact = pair(env_id, **options, max_episode_steps=15)
    off = differences(warp.reset(seed=3), exact.reset(seed=3))
    off = stepped(off, (warp, exact), 40)
    # Tensions [N] of stiff tendons, curvatures [1/m] and vectors are larger than the rest.
    names = ("tension", "curvature", "_obs")
    large = {n: v for n, v in off.items() if n == "/0" or any(x in n for x in names)}
    assert max(v for n, v in off.items() if n not in large) < 1e-4
    assert max(large.values()) < 1e-2
    assert off["/4/error"] < 3e-6


def test_options_of_a_reset():
    both = pair(ARM)
    vary = {"youngs_modulus": np.array([0.7, 1.0, 1.2, 1.0]), "tendon_radius": 0.95}
    vary["tendon_friction"] = np.array([0.0, 1.0, 0.0, 0.3])
    options = {"vary": vary, "duration": 0.2}
    options["start_curvature"] = np.resize([0.5, -0.2], both[1]._parts.bends)
    off = differences(*(env.reset(seed=0, options=dict(options)) for env in both))
    off = stepped(off, both, 8)
    again = {"reset_mask": np.array([False, True, False, True]), "duration": 0.1}
    off = largest(off, differences(*(env.reset(options=dict(again)) for env in both)))
    assert stepped(off, both, 25)["/0/tip_position"] < 3e-6


def test_twisting_robots():
    both = pair(ANY_ROBOT, robot=DRIVEN, twin=ERRING, observe="all")
    assert both[0].simulation.scene.config.torsion
    off = differences(*(env.reset(seed=3) for env in both))
    assert stepped(off, both, 30, size=0.3)["/0/tip_position"] < 3e-6


# ---------------------------------------------------------------- failures


@pytest.mark.parametrize(
    ("name", "value", "what"),
    [("qvel", np.nan, "diverged"), ("qvel", 1e12, "diverged"), ("qpos", 3.0, "left")],
)
def test_one_robot_that_fails_leaves_the_others_alone(name, value, what):
    warp, exact = pair(ARM)
    calm = made(ARM)
    for env in (warp, exact, calm):
        env.reset(seed=0)
    others = [0, 1, 3]
    for k, action in enumerate(actions(exact, 12)):
        if k == 5:
            for env in (warp, exact):
                getattr(env.simulation, name)[2] = value
        reported, true, alone = (env.step(action) for env in (warp, exact, calm))
        np.testing.assert_array_equal(reported[2].numpy(), true[2])
        assert bool(reported[2][2]) == (k == 5)
        assert reported[1][2] == pytest.approx(true[1][2], abs=1e-4)
        for key, seen in reported[0].items():
            assert torch.equal(seen[others], alone[0][key][others])
            assert torch.isfinite(seen).all()
        if k == 5:
            assert what in reported[4]["failure"][2]
            if what == "diverged":
                assert reported[4]["failure"][2] == true[4]["failure"][2]
            assert set(reported[4]["failure"][others]) == {None}
    assert float(reported[0]["tip_position"][2] @ torch.ones(2, dtype=torch.float64)) != 0


# ---------------------------------------------------------------- arrays


def test_tensors_share_the_memory_of_warp():
    import warp as wp

    env = made(ARM)
    simulation = env.simulation
    there = wp.to_torch(simulation._data.sensordata)
    assert there.data_ptr() == simulation.sensordata.data_ptr()
    seen, info = env.reset(seed=0)
    reported = env.step(torch.zeros((COUNT, 3)))
    shown = *seen.values(), *reported[0].values(), *reported[1:4], info["error"], info["_error"]
    for value in shown:
        assert isinstance(value, torch.Tensor) and value.device == simulation.arrays.device
    kept = {name: value.clone() for name, value in reported[0].items()}
    env.step(torch.ones((COUNT, 3)))
    assert all(torch.equal(value, reported[0][name]) for name, value in kept.items())
    for bad in (torch.full((COUNT, 3), 1.1), torch.full((COUNT, 2), 0.5)):
        with pytest.raises(ValueError, match="actions must be an array of 4 x 3"):
            env.step(bad)


def test_numpy_by_gymnasiums_wrapper():
    from gymnasium.wrappers.vector import ArrayConversion

    plain, exact = pair(ARM)
    env = ArrayConversion(plain, env_xp=torch, target_xp=np)
    off = differences(env.reset(seed=3), exact.reset(seed=3))
    assert stepped(off, (env, exact), 5)["/0/tip_position"] < 1e-6


# ---------------------------------------------------------------- training


def test_ppo_learns():
    stable_baselines3 = pytest.importorskip("stable_baselines3")
    from softrobot_env.training.vec_env import make_vec_env

    how = {"backend": "warp", "device": "cpu", "observe_as": "vector", "max_episode_steps": 100}
    env = make_vec_env(ARM, 32, seed=0, **how)
    torch.set_num_threads(1)
    settings = {"n_steps": 100, "batch_size": 400, "learning_rate": 1e-3, "gamma": 0.95}
    model = stable_baselines3.PPO("MlpPolicy", env, seed=0, device="cpu", **settings)
    returns = []
    for _ in range(4):
        model.learn(3200, reset_num_timesteps=False)
        returns.append(np.mean([reported["r"] for reported in list(model.ep_info_buffer)[-32:]]))
    assert returns[-1] > 1.3 * returns[0]  # measured: from 15.3 to 24.3


def test_the_command_trains(tmp_path, capsys):
    order = ["train", "ppo", "--backend", "warp", "--quick", "--task", "swing", "--start", "none"]
    order += ["--out", str(tmp_path), "--checkpoint", str(tmp_path / "checkpoint")]
    assert main([*order, "--device", "cpu"]) == 0
    assert (tmp_path / "ppo.npz").is_file()
    assert main([*order, "--device", "cuda:7", "--overwrite"]) != 0
    assert "no CUDA device 'cuda:7'" in capsys.readouterr().err


def test_speed_is_measured_by_the_number_of_robots():
    (row,) = warp_rows(True, "cpu", (8,))
    assert row.n_envs == 8 and row.steps_per_second > 1 and row.variant == "arm on cpu"
    if not torch.cuda.is_available():
        (row,) = warp_rows(True)
        assert row.variant == "not measured: no CUDA device" and row.steps_per_second is None


# ---------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"integrator": "RK4"}, "integrators extrapolation, implicitfast, discrete, got 'RK4'"),
        ({"accuracy": 1e-4}, "takes no accuracy"),
        ({"threads": 2}, "takes no threads"),
        ({"device": "cuda:7"}, "no CUDA device 'cuda:7'"),
        ({"device": "tpu"}, "unknown device 'tpu'"),
        ({"backend": "jax"}, "backend"),
        ({"backend": "mujoco"}, "device 'cpu' is for backend='warp'"),
        (
            {"randomization": Randomization(tendon_friction=(0, 1)), "integrator": "discrete"},
            "friction of tendons with integrator 'extrapolation' alone, not with 'discrete'",
        ),
        ({"robot": RUBBING, "integrator": "implicitfast"}, "alone, not with 'implicitfast'"),
        ({"robot": ISOTROPIC}, "robot 'isotropic' has ball joints"),
        ({"robot": WOUND, "randomization": Randomization(tendon_radius=(1, 2))}, "straight"),
    ],
)
def test_refusals(options, what):
    with pytest.raises(ValueError, match=what) as reported:
        make(ANY_ROBOT, **({"device": "cpu", "backend": "warp"} | options))
    assert "\n" not in str(reported.value)


def test_a_refused_variation_changes_nothing():
    env = made(ARM, integrator="implicitfast")
    env.reset(seed=0)
    before = env.simulation.qpos.clone()
    with pytest.raises(ValueError, match="friction of tendons with integrator 'extrapolation'"):
        env.reset(options={"vary": {"tendon_friction": 0.5}})
    assert torch.equal(env.simulation.qpos, before)
