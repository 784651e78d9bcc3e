"""Friction, gain and delay of the drives and noise of the sensors do what they are defined to."""

from dataclasses import replace

import gymnasium
import mujoco
import numpy as np
import pytest
from support.postures import posed

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.control.registry import make_policy
from softrobot_env.envs.disturbances import SENSOR_NOISE, Drives, SensorNoise, rounded
from softrobot_env.envs.observations.readouts import Camera, Cameras
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.rewards import TERMS
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.registration import ENVIRONMENTS
from softrobot_env.robots import ARM
from softrobot_env.robots.variations import VARIATIONS, neutral
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig, TipSensors
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.statics import equilibrium
from softrobot_env.tasks import make_task

SWING = "SoftRobot/ArmSwing-v0"
PLANTS = {"mujoco": None, "pcc": BeamPlant("pcc")}
LIMIT = 80.0


def actions(count, largest=0.5, seed=0):
    return np.random.default_rng(seed).uniform(-largest, largest, (count, 3))


def tensions(action):
    """Tensions (6,) [N] of an action by (6.8)."""
    return LIMIT * np.stack([np.maximum(action, 0), np.maximum(-action, 0)], axis=-1).ravel()


def start(env):
    return tensions(np.array(env.task.start_input) / LIMIT)


# ---------------------------------------------------------------- friction


def tip(model, posture):
    return posed(model, posture).site("tip").xpos[[0, 2]].copy()


@pytest.mark.parametrize("friction", [0.5, 3.0])
def test_slow_pull_and_release_is_the_hysteresis_of_dry_friction(friction):
    """Pulling T bends the arm as T - 2 F would without friction, releasing as T + 2 F.

    Both tendons of a pair slide, hence twice F. While neither slides the arm stays as it is.
    """
    model = build_scene(SceneConfig(ARM.vary(tendon_friction=friction))).model
    free = build_scene(SceneConfig(ARM)).model
    data, upper = mujoco.MjData(model), np.array([1.0, 0.0] * 3)
    rate, full = 1.0, 20.0  # N/s, N
    largest = 0.0
    for instant in np.arange(0, 2 * full / rate, model.opt.timestep):
        pull = full - abs(full - rate * instant)
        data.ctrl[:] = pull * upper
        mujoco.mj_step(model, data)
        if round(instant / model.opt.timestep) % 1000 == 999:
            rising = max(pull - 2 * friction, 0.0)
            falling = min(pull + 2 * friction, full - 2 * friction)
            sought = rising if instant < full / rate else falling
            expected = tip(free, equilibrium(free, sought * upper))
            largest = max(largest, np.linalg.norm(data.site("tip").xpos[[0, 2]] - expected))
    # Damping lags by mu, 0.05 N here; a newton moves the tip by up to 40 mm. Stuck tendons creep a
    # little in 10 s. The hysteresis itself is 4 F wide: 60 mm and more.
    assert largest < 4e-3


def jittering(scene, posture):
    """Tips (200, 2) [m] under tensions that jitter by 4 N every 10 ms."""
    simulation, rng = Simulation(scene), np.random.default_rng(0)
    simulation.reset(posture, np.zeros(6))
    data = simulation.data
    out = []
    for push in rng.normal(0, 4, (200, 3)) + np.linspace(-14, 14, 200)[:, None]:
        data.ctrl[0::2], data.ctrl[1::2] = np.maximum(push, 0), np.maximum(-push, 0)
        assert simulation.advance()
        out.append(data.sensordata[[0, 2]].copy())
    return np.array(out)


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
def test_friction_under_jittering_tension_is_that_of_fine_steps():
    """With implicitfast the error would be about 20 mm."""
    sensors = {"sensors": (TipSensors(),)}
    free = build_scene(SceneConfig(ARM, **sensors))
    posture = equilibrium(free.model, tensions(np.full(3, -14.0 / LIMIT)))
    robot = ARM.vary(tendon_friction=0.5)
    coarse = build_scene(SceneConfig(robot, **sensors))
    fine = build_scene(SceneConfig(robot, timestep=5e-5, integrator="implicitfast", **sensors))
    found, truth = jittering(coarse, posture), jittering(fine, posture)
    without = jittering(free, posture)
    # MuJoCo's friction is softer than Coulomb's, which ours is.
    assert np.linalg.norm(found - truth, axis=1).max() < 4e-3
    assert np.linalg.norm(without - truth, axis=1).max() > 20e-3


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
def test_stuck_tendons_carry_less_than_their_friction():
    """An arm that swings freely comes to rest away from its equilibrium."""
    env = TrackingEnv("swing", observe="all")
    rest = {}
    for friction in (0.0, 2.0):
        options = {"vary": {"tendon_friction": friction}, "start_curvature": np.full(6, 2.0)}
        env.reset(options={**options, "duration": 10.0})
        over = False
        while not over:
            observation, _, _, over, _ = env.step(np.zeros(3))
        rest[friction] = observation["curvature"]
    # Every pair rubs with 2 F at most, on the piece of its end and all below it.
    arm, pairs = ARM.tendons[0].offset[0] / ARM.bending_stiffness, np.array([3, 3, 2, 2, 1, 1])
    assert np.all(np.abs(rest[0.0]) < 1e-2)
    assert np.all(np.abs(rest[2.0]) < 2 * 2.0 * pairs * arm * 1.01)
    assert np.max(np.abs(rest[2.0])) > 0.1


#: Extremes of `vary`, by what makes them hard: tendons that rub, that go slack, modes that ring.
EXTREMES = {
    "stiff and rubbing": (
        SWING,
        {"youngs_modulus": 2.0, "density": 0.5, "damping_time": 3.0, "tendon_friction": 0.5}
        | {"tendon_radius": 0.8, "tension_gain": 0.7},
    ),
    "soft and rubbing": (
        SWING,
        {"youngs_modulus": 0.5, "density": 0.5, "damping_time": 3.0, "tendon_friction": 0.5}
        | {"tendon_radius": 1.2, "tension_gain": 1.3},
    ),
    "hardly damped": (
        SWING,
        {"youngs_modulus": 0.5, "density": 0.5, "damping_time": 0.1, "tension_gain": 1.3},
    ),
    "slack rig": (
        "SoftRobot/RigTriangle-v0",
        {"youngs_modulus": 0.5, "density": 0.5, "damping_time": 3.0, "tendon_radius": 1.2},
    ),
    "rubbing rig": (
        "SoftRobot/RigTriangle-v0",
        {"youngs_modulus": 2.0, "density": 2.0, "damping_time": 3.0, "tendon_friction": 0.5}
        | {"tendon_radius": 1.2},
    ),
}


def error_and_estimate(env_id, vary, seed, held=5, steps=60):
    """Largest error [m] of the tip in an episode of random actions, and its estimate [m].

    Against a run 300 times as accurate: MuJoCo's integrators know no Coulomb friction.
    """
    tips, estimates = [], []
    for accuracy in ("0.1%", "0.0003%"):
        env = gymnasium.make(env_id, accuracy=accuracy).unwrapped
        env.reset(seed=seed, options={"vary": vary})
        rng = np.random.default_rng(seed)
        size = (steps // held, *env.action_space.shape)
        moves = np.repeat(rng.uniform(-1, 1, size), held, axis=0).astype(np.float32)
        found = [env.step(move) for move in moves]
        assert not any(terminated for _, _, terminated, *_ in found)
        tips.append([observation["tip_position"] for observation, *_ in found])
        estimates.append(found[-1][-1]["integration_error"])
    return np.linalg.norm(np.subtract(*tips), axis=1).max(), estimates[0]


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.parametrize("name", EXTREMES)
def test_the_estimate_bounds_the_error_of_a_varied_episode_with_delay(name):
    env_id, vary = EXTREMES[name]
    for seed in (7, 8, 9):
        error, estimate = error_and_estimate(env_id, vary | {"delay": 0.3}, seed)
        assert 1e-6 < error < 2 * estimate


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
def test_the_estimate_bounds_the_errors_of_random_varied_episodes():
    """All variations at once, delays of up to 0.3 s; at most one of a hundred is beyond."""
    rng, ratios = np.random.default_rng(43), []
    factors = {"youngs_modulus": 2.0, "density": 2.0, "damping_time": 3.0, "tendon_radius": 1.2}
    for k in range(100):
        env_id = (SWING, "SoftRobot/RigTriangle-v0")[k % 2]
        vary = {name: most ** rng.uniform(-1, 1) for name, most in factors.items()}
        vary |= {"tendon_friction": max(0.0, rng.uniform(-0.5, 0.5))}
        vary |= {"delay": 0.02 * rng.integers(16)}
        if env_id == SWING:
            vary["tension_gain"] = rng.uniform(0.7, 1.3)
        error, estimate = error_and_estimate(env_id, vary, k, held=int(rng.choice((1, 5, 20))))
        ratios.append(error / estimate)
    assert np.sum(np.array(ratios) > 2) <= 1
    assert max(ratios) < 10


# ---------------------------------------------------------------- gain and delay


@pytest.mark.parametrize(
    ("env_id", "plant", "gain"),
    [
        *((SWING, plant, gain) for plant in PLANTS for gain in (0.7, 1.0, 1.3, 3.0)),
        *((env_id, "mujoco", 1.0) for env_id in ENVIRONMENTS if env_id != SWING),
    ],
)
def test_tensions_are_the_pair_formula_with_a_gain_up_to_their_limit(env_id, plant, gain, make_env):
    """(6.8) with 80 N full scale: the upper tendon takes positive entries, the lower negative."""
    env = make_env(env_id, observe="all", plant=PLANTS[plant])
    np.testing.assert_array_equal(env.input_scale, LIMIT)
    nominal, _ = env.reset()
    observation, info = env.reset(options={"vary": {"tension_gain": gain}})
    np.testing.assert_allclose(info["tendon_tension"], gain * start(env), rtol=1e-12)
    for name in ("tip_position", "curvature", "previous_action"):  # the nominal start
        np.testing.assert_array_equal(observation[name], nominal[name])
    reached = False
    for action in actions(30, largest=0.7):
        observation, *_, info = env.step(action)
        applied = np.minimum(gain * tensions(action), LIMIT)
        reached |= bool(np.any(applied == LIMIT))
        for reported in (info, observation):
            np.testing.assert_allclose(reported["tendon_tension"], applied, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(observation["previous_action"], action)
    assert reached == (gain == 3.0)


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize(("periods", "gain"), [(1, 1.0), (2, 0.5), (7, 1.0)])
def test_delay_is_the_motion_under_actions_shifted_in_time(plant, periods, gain):
    """Until the first action arrives the start tension holds the arm."""
    env, prompt = (TrackingEnv("swing", observe="all", plant=PLANTS[plant]) for _ in range(2))
    env.reset(options={"vary": {"delay": 0.01 * periods, "tension_gain": gain}})
    prompt.reset(options={"vary": {"tension_gain": gain}})
    given = actions(20)
    hold = np.array(env.task.start_input) / LIMIT
    shifted = [*[hold] * periods, *given][: len(given)]
    previous = hold
    for action, late in zip(given, shifted, strict=True):
        observation, reward, *_, info = env.step(action)
        expected, _, *_, expected_info = prompt.step(late)
        for name in ("tip_position", "tip_velocity", "curvature", "tendon_tension"):
            np.testing.assert_allclose(observation[name], expected[name], atol=1e-9, err_msg=name)
        assert info["error"] == pytest.approx(expected_info["error"], abs=1e-9)
        # Reward and observation keep to the commanded action.
        np.testing.assert_array_equal(observation["previous_action"], action)
        change = -0.05 * np.mean((action - previous) ** 2)
        assert info["reward_smoothness"] == pytest.approx(change, rel=1e-9)
        assert reward == pytest.approx(sum(info[name] for name in TERMS))
        previous = action


@pytest.mark.parametrize("period", [0.01, 0.004, 0.05])
def test_delays_are_whole_control_periods(period):
    env = TrackingEnv("swing", control_period=period)
    env.reset(options={"vary": {"delay": 2 * period + 0.9e-9}})
    for delay in (1.5 * period, 2 * period + 1.1e-9):
        with pytest.raises(ValueError, match=f"multiple of the control period, {period:g} s"):
            env.reset(options={"vary": {"delay": delay}})
    assert rounded({"delay": 1.4 * period}, period) == {"delay": period}
    drawn = TrackingEnv("swing", control_period=period, randomization=Randomization(delay=(0, 0.2)))
    delays = {drawn.reset(seed=seed)[1]["variation_delay"] for seed in range(20)}
    assert len(delays) > 3
    np.testing.assert_allclose([d / period for d in delays], [round(d / period) for d in delays])


def test_a_longer_delay_keeps_the_commands_of_running_robots():
    drives = Drives(3, np.full(1, 100.0))
    sent = np.arange(1.0, 8.0)
    drives.start(np.arange(3), np.ones(3), np.array([0, 1, 2]), np.zeros(1))
    applied = [drives.apply(np.full((3, 1), tension))[:, 0] for tension in sent[:4]]
    drives.start(np.array([0]), np.ones(1), np.array([5]), np.zeros(1))
    applied += [drives.apply(np.full((3, 1), tension))[:, 0] for tension in sent[4:]]
    assert [row[1] for row in applied] == [0, 1, 2, 3, 4, 5, 6]
    assert [row[2] for row in applied] == [0, 0, 1, 2, 3, 4, 5]
    assert [row[0] for row in applied] == [1, 2, 3, 4, 0, 0, 0]


# ---------------------------------------------------------------- noise


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_noise_is_white_gaussian_of_the_documented_deviation_and_reaches_observations_only(
    plant, scale
):
    """Reward, error, and the episode's course are those of the silent environment."""
    env = TrackingEnv("lshape", observe="all", plant=PLANTS[plant])
    hold = np.array(env.task.start_input) / LIMIT
    runs = {}
    for noise in (scale, 0.0):
        env.reset(seed=1, options={"vary": {"sensor_noise": noise}, "duration": 12.0})
        runs[noise] = [env.step(hold) for _ in range(1200)]
    for (_, earned, *_, info), (silent, reward, *_, said) in zip(*runs.values(), strict=True):
        assert earned == reward and info["error"] == said["error"]
        for name in ("tip_position", "curvature"):
            np.testing.assert_array_equal(info[name], silent[name])
            assert name not in said
    for name in env.observation_space:
        noisy, silent = (np.array([step[0][name] for step in run]) for run in runs.values())
        noise = noisy - silent
        if name not in SENSOR_NOISE:
            assert not noise.any(), name
            continue
        count = len(noise)
        deviation = scale * SENSOR_NOISE[name]
        # Five standard errors of mean, deviation, and correlation from one instant to the next.
        assert np.all(np.abs(noise.mean(axis=0)) < 5 * deviation / np.sqrt(count)), name
        np.testing.assert_allclose(noise.std(axis=0), deviation, rtol=5 / np.sqrt(2 * count))
        for lag in (1, 64):
            correlation = np.mean(noise[lag:] * noise[:-lag], axis=0) / deviation**2
            assert np.all(np.abs(correlation) < 5 / np.sqrt(count - lag)), name
        shares = [np.mean(np.abs(noise) < k * deviation) for k in (1, 2)]
        np.testing.assert_allclose(shares, [0.6827, 0.9545], atol=0.03)
        if noise.shape[1] > 1:  # channels are independent
            between = np.corrcoef(noise.T)[np.triu_indices(noise.shape[1], 1)]
            assert np.all(np.abs(between) < 5 / np.sqrt(count)), name


def test_noise_repeats_by_seed_and_does_not_depend_on_what_is_observed():
    full = TrackingEnv("swing", observe="all")
    part = TrackingEnv("swing", observe=("curvature_rate", "reference"))
    options = {"vary": {"sensor_noise": 1.0}}
    seen = []
    for env, seed in ((full, 3), (part, 3), (full, 3), (full, 4)):
        start_observation, _ = env.reset(seed=seed, options=options)
        found = [start_observation, *(env.step(action)[0] for action in actions(70))]
        seen.append(np.array([o["curvature_rate"] for o in found]))
    np.testing.assert_array_equal(seen[0], seen[1])
    np.testing.assert_array_equal(seen[0], seen[2])
    assert np.all(seen[0] != seen[3])


def test_noise_takes_one_draw_however_long_the_episode_is():
    env, short = TrackingEnv("swing"), TrackingEnv("swing")
    for each, steps in ((env, 200), (short, 1)):
        each.reset(seed=2, options={"vary": {"sensor_noise": 1.0}})
        for _ in range(steps):
            each.step(np.zeros(3))
    assert env.np_random.random() == short.np_random.random()
    # And none where there is no noise.
    for vary in ({}, {"delay": 0.02, "tension_gain": 1.1, "tendon_friction": 1.0}):
        env.reset(seed=2, options={"vary": vary})
        assert env.np_random.random() == np.random.default_rng(2).random()


def test_the_space_has_room_for_the_largest_noise(make_env):
    """At the workspace's edge too, where the noisy value alone leaves it."""
    env = make_env(observe="all")
    beyond = 0
    for seed in range(40):
        options = {"vary": {"sensor_noise": 10.0}, "start_curvature": np.full(6, 40.0)}
        observation, info = env.reset(seed=seed, options=options)
        assert env.observation_space.contains(observation)
        np.testing.assert_allclose(info["curvature"], 40.0)
        beyond += int(np.any(observation["curvature"] > 40.0))
    assert beyond > 20


def test_noise_is_bounded():
    class Wild:
        def standard_normal(self, shape):
            return np.full(shape, 9.0)

    noise = SensorNoise(1, dict.fromkeys(SENSOR_NOISE, 2))
    noise.start(0, VARIATIONS["sensor_noise"].range[1], 0)
    noise._generators[0] = Wild()
    noise.advance()
    for name, deviation in SENSOR_NOISE.items():
        np.testing.assert_allclose(noise.on(name), 60 * deviation)


def test_records_hold_the_truth():
    task = replace(make_task("lshape"), duration=0.5)
    policy = make_policy("feedforward", task.robot, 0.01)
    env = TrackingEnv(task, observe="all")
    exact = run_episode(env, policy, seed=0)
    noisy = run_episode(env, policy, seed=0, options={"vary": {"sensor_noise": 5.0}})
    for name in ("tip", "curvature", "tendon_tension", "reward"):
        np.testing.assert_array_equal(getattr(noisy, name), getattr(exact, name))


# ---------------------------------------------------------------- cameras


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("period", [0.004, 0.02, 0.05])
@pytest.mark.parametrize("coordinates", [2, 3])
def test_many_cameras_are_single_ones(delay, period, coordinates):
    """Started at different times, two of them again, over more than a block of noise."""
    rng = np.random.default_rng(0)
    many = Cameras(4, 1e-3, delay, period, coordinates)
    single = {}

    def start(which, seeds, tip):
        many.start(np.array(which), seeds, tip[which])
        for i, seed in zip(which, seeds, strict=True):
            single[i] = Camera(1e-3, delay, period, coordinates)
            single[i].start(None, [seed], tip[[i]])

    tip = rng.uniform(-1, 1, (4, coordinates))
    start(list(range(4)), [3, 4, 5, 6], tip)
    for k in range(300):
        tip = rng.uniform(-1, 1, (4, coordinates))
        which = None
        if k == 7:
            start([0, 2], [9, 9], tip)
        elif k % 10 == 0:  # some only
            which = np.array([1, 3])
        many.see(tip, which)
        for i in range(4) if which is None else which.tolist():
            single[i].see(tip[i])
        for i, camera in single.items():
            np.testing.assert_array_equal(many.position[i], camera.position)
            np.testing.assert_array_equal(many.velocity[i], camera.velocity)


# ---------------------------------------------------------------- all of them


def test_neutral_values_are_the_plain_environment():
    env, plain = TrackingEnv("swing"), TrackingEnv("swing")
    (observation, info), (expected, _) = env.reset(options={"vary": neutral()}), plain.reset()
    assert "tip_position" not in info
    for action in actions(20):
        for name, value in expected.items():
            np.testing.assert_array_equal(observation[name], value)
        observation, expected = env.step(action)[0], plain.step(action)[0]
    assert env._drives is None is env._periphery.noise and env.data.nefc == 0
