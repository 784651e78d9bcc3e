"""Learned policies: the adapter to stable-baselines3, the trainings, and what is shipped."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.commands import called

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
pytest.importorskip("daqp")

from softrobot_env.control.learned import neural  # noqa: E402
from softrobot_env.control.registry import POLICIES  # noqa: E402
from softrobot_env.core.files import models_dir  # noqa: E402
from softrobot_env.core.interfaces import quiet  # noqa: E402
from softrobot_env.envs.randomization import Randomization  # noqa: E402
from softrobot_env.envs.tracking import TrackingEnv  # noqa: E402
from softrobot_env.envs.vector import VectorTrackingEnv  # noqa: E402
from softrobot_env.learned.network import Network  # noqa: E402
from softrobot_env.robots import ARM  # noqa: E402
from softrobot_env.tasks import make_task  # noqa: E402
from softrobot_env.thesis.arm import training as references  # noqa: E402
from softrobot_env.training import artifacts, checkpoint, request, rl  # noqa: E402
from softrobot_env.training.artifacts import as_network, check, new_layers  # noqa: E402
from softrobot_env.training.imitation import ImitationConfig, imitate  # noqa: E402
from softrobot_env.training.learners import LEARNERS, actor_of, make_model, put_actor  # noqa: E402
from softrobot_env.training.rl import begin, make_training_env  # noqa: E402
from softrobot_env.training.rl_config import TRAINING_TASKS, RLConfig, preset  # noqa: E402
from softrobot_env.training.vec_env import NetworkVecEnv  # noqa: E402
from softrobot_env.training.watch import SCORE  # noqa: E402

VIEW = neural.arm_view(ARM)
SHORT = replace(make_task("swing"), duration=0.05)
TINY = RLConfig(
    hidden=(8,),
    steps=128,
    critic_steps=64,
    drawn_tasks=1,
    envs_per_task=1,
    rollout=4,
    batch=18,
    epochs=1,
    buffer=1000,
    updates=1,
    warm_up=20,
    trial_every=64,
    trials=({},),
    trial_duration=0.05,
)
ALGORITHMS = tuple(LEARNERS)

#: One in the quick runs, the others in the slow ones.
ONE_ALGORITHM = [a if a == "td3" else pytest.param(a, marks=pytest.mark.slow) for a in ALGORITHMS]
TINY_IMITATION = ImitationConfig(
    hidden=(8,), rounds=2, samples=64, shares=1, duration=0.2, epochs=1, last_epochs=2, processes=0
)


def train(config, seed, show, start=None, **settings):
    """A training of the arm, without checkpoint unless it is given."""
    order = request.TrainingRequest(ARM, Path("x.npz"), seed, {"checkpoint": None} | settings)
    return rl.train(config, order, show, start)


def part(count=2, task=SHORT, mode="SameStep", **more):
    given = {"threads": 1, "preview": neural.PREVIEW, "autoreset_mode": mode} | more
    return VectorTrackingEnv(count, task, **given)


def silent(*hidden):
    """A network whose outputs are zero."""
    made = as_network(new_layers(VIEW.count, hidden, 3))
    return made.with_parameters(0 * made.parameters)


# ---------------------------------------------------------------------- adapter


def test_the_adapter_steps_as_the_single_environment():
    env = NetworkVecEnv([part(2), part(1, make_task("lshape"))])
    seen = env.reset()
    assert seen.shape == (3, VIEW.count) and seen.dtype == np.float32
    assert seen.shape[1:] == env.observation_space.shape
    single = TrackingEnv(SHORT, preview=neural.PREVIEW)
    one, _ = single.reset()
    for _ in range(4):
        output = np.full((3, 3), 0.2, np.float32)
        seen, reward, done, infos = env.step(output)
        change = VIEW.increment(output[0].astype(float))
        one, expected, *_ = single.step(one["previous_action"] + change)
        np.testing.assert_allclose(seen[0], neural.features(one, VIEW), atol=1e-6)
        assert reward[0] == pytest.approx(expected) and not done.any()
        assert infos == [{}, {}, {}]


def test_the_adapter_reports_ends():
    env = NetworkVecEnv([part(2), part(1, make_task("lshape"))], reward_scale=0.5)
    first = env.reset()
    total = 0.0
    for _ in range(5):
        seen, reward, done, infos = env.step(np.zeros((3, 3), np.float32))
        total += 2 * reward[0]
    np.testing.assert_array_equal(done, [True, True, False])
    np.testing.assert_array_equal(seen[0], first[0])
    assert infos[2] == {}
    assert infos[0]["TimeLimit.truncated"]
    assert infos[0]["terminal_observation"].shape == first[0].shape
    assert not np.array_equal(infos[0]["terminal_observation"], first[0])
    assert infos[0]["episode"]["l"] == 5
    assert infos[0]["episode"]["r"] == pytest.approx(total)


def test_staggered_environments_end_one_by_one():
    env = NetworkVecEnv([part(5)], stagger=True)
    env.reset()
    ends = [env.step(np.zeros((5, 3), np.float32))[2] for _ in range(5)]
    assert np.array(ends)[:, 1:].argmax(axis=0).tolist() == [0, 1, 2, 3]


def test_parts_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="SameStep"):
        NetworkVecEnv([part(mode="NextStep")])
    with pytest.raises(ValueError, match="same observation"):
        NetworkVecEnv([part(), part(1, preview=(0.1,))])


def test_seeds_are_handed_on():
    ranges = Randomization(density=(0.5, 2.0))
    parts = [part(count, randomization=ranges) for count in (2, 1)]
    env = NetworkVecEnv(parts)
    seeds = env.seed(3)
    env.reset()
    drawn = [d for p in parts for d in p._info_of({})["variation_density"]]
    expected = [ranges.draw(np.random.default_rng(seed))["density"] for seed in seeds]
    assert drawn == expected and len(set(drawn)) == 3


# ---------------------------------------------------------------------- trainings


@pytest.mark.parametrize("draw", ["random_step", "random_legs", "random_waves", "known_task"])
def test_random_tasks_are_valid_and_start_at_their_reference(draw):
    for seed in range(3):
        task = getattr(references, draw)(np.random.default_rng(seed), 1.0)
        observation, info = TrackingEnv(task).reset()
        if "step" not in task.name:
            assert info["error"] < 2e-3
        assert np.all(np.isfinite(observation["reference_preview"]))


@pytest.mark.slow
def test_imitation_is_reproducible():
    one, other = (imitate(TINY_IMITATION, 3, quiet) for _ in range(2))
    np.testing.assert_array_equal(one.parameters, other.parameters)
    assert not np.array_equal(one.parameters, imitate(TINY_IMITATION, 4, quiet).parameters)


def test_another_training_is_not_gone_on_with_and_an_unfinished_one_not_overwritten(tmp_path):
    with pytest.raises(FileNotFoundError, match="no training to go on with"):
        train(TINY, 3, quiet, checkpoint=tmp_path, resume=True)
    short = replace(TINY, steps=1)
    for _ in range(2):  # the second replaces one that was finished
        train(short, 3, quiet, checkpoint=tmp_path)
    with pytest.raises(ValueError, match=r"other settings: rate 0\.0005"):
        train(replace(short, rate=1e-3), 3, quiet, checkpoint=tmp_path, resume=True)
    with pytest.raises(ValueError, match="other settings: seed 3"):
        train(short, 4, quiet, checkpoint=tmp_path, resume=True)
    kept = checkpoint.read(tmp_path)
    checkpoint.write(tmp_path, replace(kept, settings=kept.settings | {"steps": 10**6}))
    with pytest.raises(ValueError, match="not finished: resume it"):
        train(short, 3, quiet, checkpoint=tmp_path)


@pytest.mark.parametrize("algorithm", ONE_ALGORITHM)
def test_fine_tuning_starts_from_the_network_and_keeps_the_best(algorithm):
    """The best of the trials is what comes back, the start among them."""
    start = silent(8)
    config = replace(TINY, algorithm=algorithm)
    network, curve = train(config, 0, quiet, start)
    rows = check(network, config.trials, config.trial_duration, SCORE).values()
    assert np.mean([row.reward for row in rows]) == pytest.approx(
        max(point["reward"] for point in curve)
    )
    rows = check(start, config.trials, config.trial_duration, SCORE).values()
    assert np.mean([row.reward for row in rows]) == pytest.approx(curve[0]["reward"])


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_network_taken_out_of_a_learner_acts_as_the_learner(algorithm):
    config = replace(TINY, algorithm=algorithm)
    env = make_training_env(config, 0)
    model = make_model(config, env, 0)
    seen = env.reset()
    wanted, _ = model.predict(seen, deterministic=True)
    found = [np.clip(actor_of(model, config)(one.astype(float)), -1, 1) for one in seen]
    np.testing.assert_allclose(found, wanted, atol=1e-5)
    # And a network that is put in: the same, bounded by tanh where the algorithm does.
    start = as_network(new_layers(VIEW.count, config.hidden, 3))
    put_actor(model, config, start)
    found = [start(one.astype(float)) for one in seen]
    found = np.tanh(found) if LEARNERS[algorithm].squashed else np.clip(found, -1, 1)
    np.testing.assert_allclose(model.predict(seen, deterministic=True)[0], found, atol=1e-5)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_at_first_the_start_acts_and_its_critic_learns(algorithm):
    """Nothing of the actor changes, nor is its action replaced by a random one."""
    start, config = silent(8), replace(TINY, algorithm=algorithm, deviation=1e-3)
    env, outputs = make_training_env(config, 0), []
    step_async = env.step_async
    env.step_async = lambda actions: (outputs.append(np.abs(actions).max()), step_async(actions))
    model = make_model(config, env, 0)
    put_actor(model, config, start)
    before = actor_of(model, config).parameters
    critics = [p.detach().clone() for p in critic_parameters(model)]
    begin(model, config, start)
    np.testing.assert_array_equal(actor_of(model, config).parameters, before)
    after = critic_parameters(model)
    assert any(not torch.equal(p, q) for p, q in zip(critics, after, strict=True))
    assert len(outputs) > 1 and max(outputs) < 0.02
    if hasattr(model, "actor_target"):
        for p, q in zip(model.actor.parameters(), model.actor_target.parameters(), strict=True):
            assert torch.equal(p, q)


def critic_parameters(model):
    if hasattr(model, "critic"):
        return list(model.critic.parameters())
    return list(model.policy.mlp_extractor.value_net.parameters())


@pytest.mark.parametrize("algorithm", [pytest.param("sac", marks=pytest.mark.slow), "td3"])
def test_bounded_networks_start_bounded_algorithms_only(algorithm):
    config = replace(TINY, algorithm=algorithm)
    model = make_model(config, make_training_env(config, 0), 0)
    made = actor_of(model, config)
    put_actor(model, config, made)
    np.testing.assert_array_equal(actor_of(model, config).parameters, made.parameters)
    with pytest.raises(ValueError, match="layers of 29-8-3-3, ppo needs 29-8-3"):
        put_actor(make_model(TINY, make_training_env(TINY, 0), 0), TINY, made)
    wide = as_network(new_layers(VIEW.count, (9,), 3))
    with pytest.raises(ValueError, match=r"29-9-3.* needs 29-8-3"):
        put_actor(model, config, wide)


@pytest.mark.parametrize(
    "algorithm", [a if a == "ppo" else pytest.param(a, marks=pytest.mark.slow) for a in ALGORITHMS]
)
def test_a_stopped_training_goes_on_as_if_it_had_not_been(algorithm, tmp_path):
    config = replace(TINY, algorithm=algorithm)

    def stop(_, steps, __):
        if steps >= 100:
            raise KeyboardInterrupt

    network, curve = train(config, 3, quiet, checkpoint=tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        train(config, 3, stop, checkpoint=tmp_path / "kept")
    kept = checkpoint.read(tmp_path / "kept").curve
    assert 0 < kept[-1]["steps"] < 100 and len(kept) < len(curve)
    found, same = train(config, 3, quiet, checkpoint=tmp_path / "kept", resume=True)
    assert same == curve
    np.testing.assert_array_equal(found.parameters, network.parameters)


def test_a_training_goes_on_for_longer_and_its_trials_are_logged_for_tensorboard(tmp_path):
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    kept, curve = tmp_path / "kept", []
    for folder, steps in (("one", 72), ("two", 128)):
        before, more = curve, {"checkpoint": kept, "resume": folder == "two"}
        log = tmp_path / folder
        network, curve = train(replace(TINY, steps=steps), 3, quiet, log=log, **more)
        assert curve[: len(before)] == before and curve[-1]["steps"] >= steps
        events = accumulator.EventAccumulator(str(next(log.iterdir()))).Reload()
        logged = [(event.step, event.value) for event in events.Scalars("trial/reward")]
        added = curve[len(before) :]
        assert logged == [(point["steps"], pytest.approx(point["reward"])) for point in added]
    again, same = train(TINY, 3, quiet, checkpoint=kept, resume=True)
    assert same == curve
    np.testing.assert_array_equal(again.parameters, network.parameters)


def test_seeds_of_trainings_share_nothing():
    seeds = [set(make_training_env(TINY, seed).seed(seed)) for seed in range(3)]
    assert not (seeds[0] & seeds[1] or seeds[1] & seeds[2] or seeds[0] & seeds[2])


def test_tasks_can_be_chosen():
    drawn = {"random step", "random legs", "random waves", "step", "swing", "lshape"}
    for name in TRAINING_TASKS:
        env = make_training_env(replace(TINY, tasks=(name,)), 0)
        assert {part.task.name for part in env.parts} <= (drawn if name == "drawn" else {name})


def test_robots_and_disturbances_are_drawn_for_every_episode():
    env = make_training_env(replace(preset("ppo", True, True), drawn_tasks=0, envs_per_task=3), 5)
    env.reset()
    info = env.parts[0]._info_of({})
    for name in ("youngs_modulus", "density", "delay", "sensor_noise", "tendon_friction"):
        assert len(set(info[f"variation_{name}"])) == 3 or name == "delay"


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"algorithm": "dqn"}, "choose from ppo, sac, td3"),
        ({"tasks": ("juggle",)}, "step, swing, lshape, drawn"),
        ({"tasks": ()}, "one or more"),
        ({"steps": 0}, "steps must be a whole number, 1 or more"),
        ({"deviation": -1.0}, "deviation must be from 1e-12 to 100"),
        ({"rate": float("nan")}, "rate must"),
        ({"tasks": ("drawn",), "drawn_tasks": 0}, "drawn_tasks must be 1"),
    ],
)
def test_bad_settings_are_refused(change, reason):
    with pytest.raises(ValueError, match=reason):
        replace(TINY, **change)


@pytest.mark.parametrize("words", ["imitation", "--algo sac"])
def test_missing_packages_are_told_with_their_cure(words, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(request, "find_spec", lambda name: None)
    assert called("train", words, "--out", tmp_path / "none") == 2
    assert "needs torch" in (reported := capsys.readouterr().err) and "pip install" in reported
    assert not (tmp_path / "none").exists()


@pytest.mark.slow
def test_the_command_trains_and_goes_on(tmp_path, capsys):
    artifacts.save(silent(128, 128), tmp_path / "start.npz", 0)
    words = "train --algo ppo --task step --name one --set envs_per_task=1 --set rollout=4"
    words += f" --set critic_steps=0 --set batch=16 --start {tmp_path}/start.npz"
    words += f" --checkpoint {tmp_path}/kept --out {tmp_path} --steps"
    assert called(words, 16) == 0
    assert (tmp_path / "one.npz").is_file() and (tmp_path / "one_curve.json").is_file()
    assert "overshoot" in capsys.readouterr().out
    assert called(words, "32 --resume") == 0
    curve = json.loads((tmp_path / "one_curve.json").read_text())
    assert [point["steps"] for point in curve][-1] >= 32


# ---------------------------------------------------------------------- what is shipped


def test_shipped_network_is_small_and_says_what_it_is():
    path = models_dir() / "imitation.npz"
    assert path.stat().st_size < 1e6
    network, about = Network.load(path)
    assert network.sizes[0] == VIEW.count and str(about["robot"]) == "arm"
    start, view = artifacts.load_start(path)
    assert len(start.parameters) == len(network.parameters) and view == VIEW


NETWORKS = [name for name, spec in POLICIES.items() if ":NeuralPolicy" in spec.make]

#: Network, variation, duration [s], largest errors [mm] on swing and L-shape, and overshoot and
#: settling time [s] of steps by their width [mm].
SHIPPED = [
    ("imitation", {}, None, 1.5, 1.0, dict.fromkeys((50, 100, 200), (0.06, 0.3))),
    ("ppo", {}, None, 6.0, 2.0, {50: (0.2, np.inf)}),  # of those without a teacher the best
    # `ppo`, without disturbances in its training, is off by 98 and 19 mm on the swing.
    ("ppo_randomized", {"delay": 0.01}, None, 5.0, 5.0, {}),
    ("ppo_randomized", {"sensor_noise": 1.0}, None, 5.0, 5.0, {}),
    # Far below the quasi-static controller's 530 and 240 mm.
    *(
        pytest.param(
            *(name, {"youngs_modulus": factor}, 5.0),
            *(
                2 * [60.0 if name == "sac_randomized" else 40.0]
            ),  # its L-shape is poor, see its card
            {},
            marks=[pytest.mark.slow] if factor == 1.5 else [],
        )
        for name in NETWORKS
        for factor in (0.5, 1.5)
    ),
]


@pytest.mark.parametrize(("name", "vary", "duration", "swing", "lshape", "steps"), SHIPPED)
def test_shipped_networks_meet_their_figures(name, vary, duration, swing, lshape, steps):
    network, _ = Network.load(models_dir() / f"{name}.npz")
    rows = check(network, (vary,), duration)
    assert not any(row.failure for row in rows.values())
    found = {label.split(",")[0]: row for label, row in rows.items()}
    assert 1e3 * found["swing"].e_max < swing and 1e3 * found["lshape"].e_max < lshape
    for width, (overshoot, settling) in steps.items():
        step = found[f"step {width} mm"].step
        assert step.overshoot < overshoot and step.settling_time < settling
