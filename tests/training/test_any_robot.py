"""Trainings for a user's own robot: what they write, where it is found, what is refused."""

import time
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from support.commands import called, evaluated

from softrobot_env.control.learned import neural
from softrobot_env.control.registry import incompatibility, make_policy, policy_environment
from softrobot_env.core.registry import is_path, load
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.learned.network import Scaling, initial_network
from softrobot_env.robots import ARM, RIG, ROBOTS, find_robot, read_robot, write_robot
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.artifacts import (
    artifact_name,
    find_artifact,
    fingerprint,
    looked_up,
    train_command,
)
from softrobot_env.tasks import make_task
from softrobot_env.training.references import generic_task, training_of, view_for
from softrobot_env.training.registry import TRAININGS
from softrobot_env.training.request import TrainingRequest, file_of

FINGER = ROBOTS["planar_finger"]
OTHERS = (
    "planar_finger",
    "rig",
    *(
        pytest.param(n, marks=pytest.mark.slow)
        for n in ("silicone_rod", "hanging_trunk", "ftdcr_v4")
    ),
)


@pytest.fixture
def mine(tmp_path):
    """A robot that has a file."""
    write_robot(FINGER, tmp_path / "mine.toml")
    return read_robot(tmp_path / "mine.toml")


def untrained(view):
    """A network of a view before any training, whose outputs are small."""
    ends = [Scaling(-np.ones(count), np.ones(count)) for count in (view.count, view.inputs)]
    network = initial_network((8,), *ends, np.random.default_rng(0))
    return network.with_parameters(0.1 * network.parameters)


def save(robot, policy, folder=None):
    """Write an untrained network where a policy looks for it."""
    view, path = view_for(robot), file_of(robot, policy, folder)
    untrained(view).save(path, {**fingerprint(robot), **view.about(), "seed": 0})
    return path


# ---------------------------------------------------------------- fingerprints and places


def test_equal_robots_have_one_fingerprint_and_others_another(mine):
    def of(robot):
        return str(fingerprint(robot)["fingerprint"])

    assert of(mine) == of(FINGER) == of(replace(FINGER, name="called otherwise"))
    assert of(replace(ARM, length=np.float64(ARM.length))) == of(ARM)
    changed = [
        FINGER.vary(damping_time=1.001),
        replace(FINGER, gravity=(0.0, 0.0, 9.81)),
        replace(RIG, drive=replace(RIG.drive, speed=0.2)),
        RIG,
        replace(FINGER, tendons=FINGER.tendons[::-1]),
        replace(FINGER, sections=FINGER.sections[::-1]),
        FINGER.vary(tendon_radius=1.1),
    ]
    assert len({of(robot) for robot in (FINGER, *changed)}) == 1 + len(changed)


def test_what_lies_beside_the_robots_file_comes_first(mine, tmp_path):
    assert find_artifact(ARM, "ppo") == file_of(ARM, "ppo")
    # What is shipped, of the arm: it is found to be refused, and nothing acts on it.
    assert find_artifact(mine, "ppo") == file_of(ARM, "ppo") == looked_up(ARM, "ppo")
    assert looked_up(mine, "ppo") is None
    save(mine, "ppo")
    assert looked_up(mine, "ppo") == file_of(mine, "ppo")
    assert find_artifact(mine, "ppo") == tmp_path / "mine.ppo.npz" == file_of(mine, "ppo")
    with pytest.raises(ValueError, match=r"never has not been trained .*train never --robot"):
        find_artifact(mine, "never")


def test_the_command_that_is_advised_names_the_robot_as_commands_know_it(mine):
    assert train_command(RIG, "rig_nn") == "softrobot train rig_nn --robot rig"
    assert train_command(mine, "sac") == f"softrobot train sac --robot {mine.file}"
    for changed in (ARM.vary(density=1.1), mine.vary(density=1.1)):
        with pytest.raises(ValueError, match=r"write_robot.*--robot \w+_changed\.toml"):
            find_artifact(changed, "never")


@pytest.mark.parametrize("policy", ["imitation", "ppo", "sac", "qs_nn", "lqi", "lq_preview", "mpc"])
def test_policies_without_training_advise_theirs(policy, mine):
    assert f"`softrobot train {policy} --robot {mine.file}`" in incompatibility(policy, mine)


def test_a_file_of_a_robot_that_has_changed_is_refused(mine):
    save(mine, "ppo")
    assert incompatibility("ppo", mine) is None
    write_robot(FINGER.vary(damping_time=2), mine.file)
    assert f"`softrobot train ppo --robot {mine.file}`" in incompatibility(
        "ppo", read_robot(mine.file)
    )


# ---------------------------------------------------------------- networks of any robot


def test_the_arm_is_seen_as_its_shipped_networks_were_trained():
    """The thesis' scales, which files of networks did not tell once."""
    view = neural.arm_view(ARM)
    assert view_for(ARM) == view and view.count == 29
    assert (view.coarse, view.fine, view.velocity, view.ahead) == (0.05, 0.001, 0.1, 0.02)
    assert (view.scales, view.action) == ((3.0, 20.0), 0.15)
    assert policy_environment("ppo") == {"control_period": 0.01, "preview": neural.PREVIEW}


@pytest.mark.parametrize("name", OTHERS)
def test_a_network_sees_a_robot_at_scales_of_its_own(name):
    """Of order 1 while it follows its circle with the inputs that hold it there."""
    robot = find_robot(name)
    view, task = view_for(robot), generic_task("circle", robot)
    env = TrackingEnv(task, observe="all", **view.environment)
    policy, seen = make_policy("hold", env), []
    observation, _ = env.reset()
    assert {n: observation[n].size for n in view.observed} == view.observed
    for _ in range(50):
        observation, *_ = env.step(policy.predict(observation)[0])
        seen.append(neural.features(observation, view))
    assert seen[0].shape == (view.count,)
    assert 0.05 < np.abs(seen).max() < 10


def test_the_view_of_a_file_is_the_view_it_was_trained_with(mine):
    save(mine, "ppo")
    needs = policy_environment("ppo", mine)
    assert needs == view_for(mine).environment and needs["control_period"] < neural.PERIOD
    env = gymnasium.make("SoftRobot/Track-v0", robot=str(mine.file), observe="all", **needs)
    policy = make_policy("ppo", env)
    assert policy.view == view_for(mine)
    observation, _ = env.reset(seed=0)
    change = untrained(policy.view)(neural.features(observation, policy.view)[None])[0]
    wanted = observation["previous_action"] + policy.view.increment(change)
    np.testing.assert_allclose(policy.predict(observation)[0], wanted, atol=1e-6)


# ---------------------------------------------------------------- the command


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        ("imitation", "--teacher static"),
        ("ppo", "--start none --steps 64 --set envs_per_task=1 --checkpoint kept"),
        ("qs_nn", ""),
        ("lq_preview", ""),
    ],
)
@pytest.mark.slow
def test_the_command_trains_for_any_robot(policy, words, mine, tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3")
    pytest.importorskip("daqp")
    monkeypatch.chdir(tmp_path)
    assert called("train", policy, words, "--quick --robot", mine.file) == 0
    assert (tmp_path / artifact_name(mine, policy)).is_file()
    words = "--duration 0.1 --tasks circle --policies"
    assert evaluated(tmp_path / "out", words, policy, "--robot", mine.file)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar_finger", "silicone_rod"])
def test_an_imitation_tracks_about_as_its_teacher_does(name):
    """On a path, a pace and a robot that it was not trained on, unlike holding still."""
    pytest.importorskip("torch")
    from softrobot_env.evaluation.runner import Case, run
    from softrobot_env.training.imitation import imitate, settings_of

    robot = find_robot(name)
    lesson = training_of(robot).imitation("static")
    config = replace(settings_of(lesson), rounds=3, samples=6000, shares=2, processes=0)
    network, view = imitate(config, 0, lambda *_: None, lesson), lesson.view
    task = make_task("figure_eight", robot=robot, frequency=0.07)
    errors = {}
    for policy in ("static", "hold"):
        errors[policy] = np.mean(run(Case(task, policy)).rollout.error)
    made = neural.NeuralPolicy(robot, view.period, network, view=view)
    env = TrackingEnv(task, observe="all", **view.environment)
    errors["network"] = np.mean(run(Case(task, "network"), env, made).rollout.error)
    # A training of a minute: by seed it errs by a fifth to a half of what standing still does.
    assert errors["network"] < errors["hold"] / 2, errors


def test_what_trainings_load_by_name_is_there():
    for training in TRAININGS.values():
        for path in (training.how, *getattr(training.how, "args", ())):
            assert not (isinstance(path, str) and is_path(path)) or callable(load(path))


def test_every_training_says_of_which_robots_it_is():
    for training in TRAININGS.values():
        if training.robot is None:
            training.check(FINGER)
        else:
            with pytest.raises(ValueError, match="alone, not for 'planar_finger'"):
                training.check(FINGER)


# ---------------------------------------------------------------- imitation


def test_packages_are_asked_for_by_the_teacher(monkeypatch, capsys, mine):
    """Only model predictive teachers need a solver, and nothing long comes before that is said."""
    from softrobot_env.training import request

    monkeypatch.setattr(request, "find_spec", lambda package: None if package == "daqp" else 1)
    training = TRAININGS["imitation"]
    training.check(FINGER)
    for robot, settings in ((ARM, {}), (FINGER, {"teacher": "mpc_preview"})):
        with pytest.raises(ImportError, match="imitation needs daqp: pip install"):
            training.check(robot, settings)
    began = time.process_time()
    given = ("--robot", mine.file, "--teacher mpc --out", mine.file.parent)
    assert called("train imitation", *given) == 2
    assert "imitation needs daqp" in capsys.readouterr().err and time.process_time() - began < 1


def test_a_network_decides_as_often_as_its_teacher_and_moves_as_far_as_servos_can():
    pytest.importorskip("torch")
    for name in ("planar_finger", "silicone_rod", "hanging_trunk"):
        robot = find_robot(name)
        view = training_of(robot).imitation().view
        assert view.period == policy_environment("lq_preview", robot)["control_period"]
        np.testing.assert_allclose(view.increment(np.ones(1)), view.most)
        np.testing.assert_allclose(view.output_of(view.increment(np.array([-0.3]))), -0.3)
    rod = find_robot("silicone_rod")
    view, travel = view_for(rod), robot_inputs(rod).input_scale
    turned = rod.drive.speed * view.period / travel.min()
    assert turned < view.most < 3 * turned and "tendon_length" in view.state
    assert view_for(FINGER).most == 1 and "tendon_length" not in view_for(FINGER).state


def test_files_from_before_changes_had_a_scale_are_read(mine):
    view, path = view_for(mine), file_of(mine, "ppo")
    about = {n: v for n, v in view.about().items() if n not in ("view_change", "view_most")}
    untrained(view).save(path, {**fingerprint(mine), **about, "seed": 0})
    read = make_policy("ppo", mine, view.period).view
    assert (read.change, read.most) == (0.01, 1.0) and read.scales == view.scales


def test_the_teachers_table_is_found_where_the_network_is_written(tmp_path):
    pytest.importorskip("torch")
    assert training_of(FINGER).imitation(None, tmp_path).file is None
    table = tmp_path / artifact_name(FINGER, "lq_preview")
    table.write_bytes(b"")
    assert training_of(FINGER).imitation(None, tmp_path).file == table
    assert training_of(FINGER).imitation("static", tmp_path).file is None


def test_tables_of_a_robot_share_their_operating_points(monkeypatch, tmp_path):
    from softrobot_env.control.scheduled import operating_points
    from softrobot_env.training import registry

    found = []

    def few(robot, **options):
        found.append(options["plant"])
        return find_points(robot, most=5, candidates=20, plant=options["plant"])

    find_points = operating_points.find_points
    monkeypatch.setattr(operating_points, "find_points", few)
    monkeypatch.setattr(registry, "_FOUND", {})
    for policy, plant in (("lqi", "mujoco"), ("lq_preview", "mujoco"), ("lqi", "pcc")):
        order = TrainingRequest(FINGER, tmp_path / f"{policy}_{plant}.npz", 0, {"plant": plant})
        TRAININGS[policy].run(order, lambda *_: None)
    assert found == ["mujoco", "pcc"]
    rows = [np.load(tmp_path / f"lqi_{plant}.npz")["rows"] for plant in ("mujoco", "pcc")]
    assert not np.array_equal(*rows)
