"""Parts of others: by calls, entry points, modules and files.

Each file of `tests/outside` adds a part of the package, for single environments and for many: it
has a function `register`, as a package names it in the entry-point group, and at most 60 lines;
`CHECKS` says what must hold of it.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from support.commands import MINE, rows_in
from support.processes import finished

import softrobot_env
from softrobot_env.cli import main
from softrobot_env.control.registry import (
    EVERY_POLICY,
    fitting_policies,
    make_policy,
    policy_environment,
)
from softrobot_env.core import registry as registries
from softrobot_env.core.files import assets_dir
from softrobot_env.core.registry import Registry, load
from softrobot_env.core.studies import BENCHMARKS
from softrobot_env.envs.observations.table import OBSERVABLES
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.rewards import REWARDS, TERMS
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.robots import ARM, ENTRIES, EXAMPLES, RIG, ROBOTS, find_robot, write_robot
from softrobot_env.robots.variations import VARIATIONS
from softrobot_env.tasks import EVERY_TASK, SetPoints, Task, make_task, remake_task, tasks_of
from softrobot_env.tasks.generic import GENERIC_TASKS
from softrobot_env.tasks.registry import OWN_TASKS

FILES = sorted((Path(__file__).parent / "outside").glob("*.py"))

#: Registries, and tables of the kind.
REGISTRIES: tuple[Registry, ...] = (
    *(VARIATIONS, OBSERVABLES, REWARDS, BENCHMARKS, ROBOTS, ENTRIES),
    *(EVERY_TASK, GENERIC_TASKS, EVERY_POLICY),
)

FINGER = find_robot("planar_finger")


def stay(robot, seconds=0.5, height=0.0):
    """Stay at the straight pose, or so far above it."""
    points = SetPoints(((0.0, 0.0, robot.reach + height),), float(seconds))
    return Task("stay", robot, points, float(seconds), (0.0, 0.0))


def stay_finger(seconds=0.5):
    return stay(FINGER, seconds)


class Nothing:
    """Acts on nothing."""

    def __init__(self, robot, control_period):
        self.count = len(robot.tendons) // 2

    def act(self, observation):
        return np.zeros(self.count, dtype=np.float32)


class Learned:
    """Like a model of stable-baselines3 with the observables it was trained on."""

    def __init__(self, names, size):
        self.observation_space = gymnasium.spaces.Dict(
            {name: gymnasium.spaces.Box(-1, 1, (1,)) for name in names}
        )
        self.seen, self.size = set(), size

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        self.seen |= set(observation)
        return np.zeros(self.size, dtype=np.float32), state


#: A robot in gravity.
HEAVY = replace(FINGER, name="heavy", gravity=(0.0, 0.0, -9.81))
HANGING = {"robot": HEAVY, "task": "circle", "observe": "all"}


@pytest.fixture(autouse=True)
def as_before():
    """Registries as they were."""
    tables = [*(registry._own for registry in REGISTRIES), OWN_TASKS]
    before = [{k: dict(v) if isinstance(v, dict) else v for k, v in t.items()} for t in tables]
    yield
    for table, entries in zip(tables, before, strict=True):
        table.clear()
        table.update(entries)


def both(steps=5, env_id="SoftRobot/Track-v0", vary=None, **options):
    """Steps of a single environment, and of the second of two, which does the same."""
    one, many = gymnasium.make(env_id, **options), gymnasium.make_vec(env_id, 2, **options)
    one.reset(seed=0, options={} if vary is None else {"vary": vary})
    pairs = {} if vary is None else {"vary": {n: np.array([1.0, v]) for n, v in vary.items()}}
    many.reset(seed=[5, 0], options=pairs)
    action = np.full(one.action_space.shape, 0.2, np.float32)
    for _ in range(steps):
        yield one, one.step(action), many.step(np.tile(action, (2, 1)))


def check_variation(_path, tmp_path):
    usual = [step[0]["tip_position"] for _, step, _ in both(**HANGING)][-1]
    for factor, differs in ((1.0, False), (3.0, True)):
        for env, single, many in both(vary={"gravity": factor}, **HANGING):
            np.testing.assert_array_equal(many[0]["tip_position"][1], single[0]["tip_position"])
            np.testing.assert_allclose(env.unwrapped.model.opt.gravity, (0, 0, -9.81 * factor))
        assert (not np.array_equal(single[0]["tip_position"], usual)) == differs
        np.testing.assert_allclose(many[0]["tip_position"][0], usual, atol=1e-12)
    for _, single, many in both(randomization=Randomization(gravity=(2.0, 2.0)), **HANGING):
        assert single[-1]["variation_gravity"] == 2.0
        np.testing.assert_array_equal(many[-1]["variation_gravity"], [2.0, 2.0])
        np.testing.assert_array_equal(many[0]["tip_position"][1], single[0]["tip_position"])
    write_robot(HEAVY, tmp_path / "heavy.toml")
    command = f"evaluate --robot {tmp_path}/heavy.toml --tasks circle --policies hold"
    command += " --duration 0.05"
    assert main([*command.split(), "--vary", "gravity=2", "--out", str(tmp_path / "out")]) == 0
    texts = [path.read_text() for path in (tmp_path / "out").rglob("*") if path.suffix == ".md"]
    assert any("g x 2" in text for text in texts)
    with pytest.raises(SystemExit):
        main([*command.split(), "--vary", "gravity=11", "--out", str(tmp_path / "no")])


def check_observable(_path, _tmp_path):
    asked = ("pull", "tendon_tension")
    for env, single, many in both(observe=asked, task="circle"):
        assert env.observation_space.contains(single[0])
        for seen in (single[0], many[0]):
            np.testing.assert_allclose(seen["pull"][..., 0], seen["tendon_tension"].sum(axis=-1))
        np.testing.assert_array_equal(many[0]["pull"][1], single[0]["pull"])
    for _, single, many in both(observe=asked, observe_as="vector", task="circle"):
        np.testing.assert_array_equal(many[0][1], single[0])
    for _, single, _ in both(steps=1, observe="all", task="circle"):
        assert "pull" not in single[0]  # policies of others do not know it


def check_reward(_path, _tmp_path):
    for _, single, many in both(reward="calm", task="circle", observe="all"):
        (seen, reward, *_, info), (observed, rewards, *_, infos) = single, many
        haste = -0.1 * np.sum(seen["tip_velocity"] ** 2)
        assert info["reward_haste"] == pytest.approx(haste) and haste < 0
        assert reward == pytest.approx(sum(info[name] for name in (*TERMS, "reward_haste")))
        np.testing.assert_allclose(
            infos["reward_haste"], -0.1 * np.sum(observed["tip_velocity"] ** 2, axis=1)
        )
        assert rewards[1] == pytest.approx(reward)


def check_study(path, folder):
    """It measures, writes and draws, and draws the same again of its files."""
    pytest.importorskip("matplotlib")
    words, out = ["benchmark", "lengths", "--out", str(folder)], folder / "lengths"
    assert main(words) == 0
    rows = rows_in(out)
    assert [row["share"] for row in rows] == [0.5, 1.0] * 2
    before = [(out / name).read_bytes() for name in ("lengths.png", "report.json")]
    assert main([*words, "--redraw"]) == 0
    assert [(out / name).read_bytes() for name in ("lengths.png", "report.json")] == before
    meta = json.loads(before[1])["meta"]
    assert (
        meta["seconds"] > 0
        and {"studies.lab", "softrobot_env.robots.file"} <= meta["sources"].keys()
    )
    assert main([*words, "--quick", "--overwrite"]) == 0
    assert len(rows_in(out)) == 2


def check_law(options, policy, *_):
    """A policy of one, of its robot and on its task, does the same in both."""
    needs = policy_environment(policy, options["robot"])
    one = gymnasium.make("SoftRobot/Track-v0", **options, **needs)
    many = gymnasium.make_vec("SoftRobot/Track-v0", 2, **options, **needs)
    acting, state = make_policy(policy, one), None
    (observation, _), _ = one.reset(seed=0), many.reset(seed=0)
    for _ in range(5):
        action, state = acting.predict(observation, state)
        observation, reward, terminated, *_ = one.step(action)
        stacked, _, ended, *_ = many.step(np.stack([action, action]))
        assert np.isfinite(reward) and not terminated and not ended.any()
    np.testing.assert_allclose(
        stacked["tip_position"], [observation["tip_position"]] * 2, rtol=0, atol=1e-9
    )
    assert one.unwrapped.task.name == options["task"]
    assert one.unwrapped.task.robot.name == options["robot"]


CHECKS: dict[str, Callable[[Path, Path], None]] = {
    "study": check_study,
    "variation": check_variation,
    "observable": check_observable,
    "reward": check_reward,
    "policy": partial(check_law, {"robot": "planar_finger", "task": "circle"}, "proportional"),
    "robot": partial(check_law, {"robot": "worm", "task": "figure_eight"}, "feedforward_pi"),
    "task": partial(check_law, {"robot": "planar_finger", "task": "to_and_fro"}, "static"),
}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_one_file_adds_a_part(path, tmp_path):
    assert len(path.read_text().splitlines()) <= 60
    load(f"{path}:register")()
    CHECKS[path.stem](path, tmp_path)


# ---------------------------------------------------------------- calls


def test_a_registered_robot_is_found_by_its_name():
    made = softrobot_env.register_robot(assets_dir() / "robots" / "planar_finger.toml", "mine")
    assert made == replace(FINGER, name="mine") == find_robot("mine")
    env = gymnasium.make("SoftRobot/Track-v0", robot="mine", task="reach")
    assert env.unwrapped.task.robot == made


def test_a_task_for_any_robot_takes_the_robot():
    softrobot_env.register_task("stay", stay)
    assert "stay" in tasks_of("planar_finger") and "stay" not in EVERY_TASK
    task = make_task("stay", robot="planar_finger", seconds=0.3)
    assert task.robot == FINGER and task.duration == 0.3
    assert remake_task(task, seconds=0.4).duration == 0.4
    env = gymnasium.make("SoftRobot/Track-v0", robot=FINGER, task="stay", seconds=0.3)
    assert env.unwrapped.task == task


def test_a_robots_own_task_is_found_by_name_alone():
    softrobot_env.register_task("stay", stay_finger, robot="planar_finger")
    assert make_task("stay").robot == FINGER == TrackingEnv("stay").task.robot
    assert "stay" not in tasks_of("silicone_rod")
    softrobot_env.register_task("swing", stay_finger, robot="planar_finger")
    assert make_task("swing").robot == ARM  # who had the name first
    assert make_task("swing", robot=FINGER).robot == FINGER


def test_a_robot_that_only_has_an_others_name_does_not_get_its_tasks():
    assert list(tasks_of(RIG))[-2:] == ["triangle", "rig_circle"]
    assert list(tasks_of(replace(ARM, youngs_modulus=6e5))) == list(GENERIC_TASKS)


def test_a_registered_policy_drives_a_robot():
    softrobot_env.register_policy("nothing", Nothing, robots=["planar_finger"])
    env = TrackingEnv(stay(FINGER), observe="all")
    rollout = run_episode(env, make_policy("nothing", FINGER, env.control_period))
    assert rollout.failure is None and not rollout.action.any()
    with pytest.raises(ValueError, match="'silicone_rod': it drives planar_finger only"):
        make_policy("nothing", find_robot("silicone_rod"), 0.01)
    assert fitting_policies(FINGER)["nothing"] is None
    assert "has not been trained" in fitting_policies(FINGER)["lqi"]


def test_a_policy_says_what_a_robot_lacks():
    def lacks(robot):
        return None if robot.head is not None else "it needs a head"

    softrobot_env.register_policy("nothing", Nothing, robots=lacks)
    with pytest.raises(ValueError, match="robot 'planar_finger': it needs a head"):
        make_policy("nothing", FINGER, 0.01)
    assert make_policy("nothing", RIG, 0.01).predict({})[0].shape == (1,)


def test_a_model_sees_what_it_was_trained_on():
    model = Learned(("tip_position", "reference"), 2)
    softrobot_env.register_policy("model", model, environment={"control_period": 0.05})
    assert policy_environment("model") == {"control_period": 0.05}
    env = TrackingEnv(stay(FINGER), observe="all", **policy_environment("model"))
    assert run_episode(env, make_policy("model", FINGER, 0.05)).failure is None
    assert model.seen == {"tip_position", "reference"}


@pytest.mark.parametrize(
    ("register", "error", "message"),
    [
        (lambda s: s.register_robot(FINGER), ValueError, "'planar_finger' is there already"),
        (lambda s: s.register_robot(FINGER, "all"), ValueError, "'all'"),
        (lambda s: s.register_robot(FINGER, "my robot"), ValueError, "letters, digits"),
        (lambda s: s.register_robot(3), TypeError, "RobotParams or the path"),
        (lambda s: s.register_robot("no.toml"), OSError, "no.toml"),
        (lambda s: s.register_task("circle", stay), ValueError, "'circle' is there already"),
        (lambda s: s.register_task("swing", stay_finger, "arm"), ValueError, "'arm' has a task"),
        (lambda s: s.register_task("stay", stay_finger), ValueError, "must take the robot"),
        (lambda s: s.register_task("stay", stay, "arm"), ValueError, "must take nothing"),
        (lambda s: s.register_task("stay", 3), TypeError, "must be a function"),
        (lambda s: s.register_task("stay", stay, "nobody"), ValueError, "must take nothing"),
        (lambda s: s.register_task("stay", stay_finger, "nobody"), ValueError, "unknown robot"),
        (lambda s: s.register_policy("lqi", Nothing), ValueError, "'lqi' is there already"),
        (lambda s: s.register_policy("three", 3), TypeError, "'int' has neither"),
        (lambda s: s.register_policy("path", "a.b"), ValueError, "package.module:name"),
    ],
)
def test_what_cannot_be_registered_is_refused(register, error, message):
    with pytest.raises(error, match=message):
        register(softrobot_env)


def test_a_name_is_replaced_on_demand():
    softrobot_env.register_robot(replace(FINGER, damping_time=None), "planar_finger", replace=True)
    softrobot_env.register_task("circle", stay, replace=True)
    softrobot_env.register_policy("hold", Nothing, replace=True)
    assert make_task("circle", robot=FINGER).name == "stay"
    assert make_policy("hold", FINGER, 0.01).predict({})[0].tolist() == [0, 0]


def test_what_makes_no_policy_is_reported():
    softrobot_env.register_policy("bare", object)
    with pytest.raises(ValueError, match=r"'bare'.*must take \(robot, control_period\)"):
        make_policy("bare", FINGER, 0.01)
    softrobot_env.register_policy("text", lambda robot, control_period: "text")
    with pytest.raises(ValueError, match="'str' has neither"):
        make_policy("text", FINGER, 0.01)
    softrobot_env.register_task("three", lambda robot: 3)
    with pytest.raises(ValueError, match="'three' must return a Task, got int"):
        make_task("three", robot=FINGER)


# ---------------------------------------------------------------- modules and files


FILE = f"""{MINE}
from softrobot_env.robots import find_robot

FIXED = stay(find_robot("planar_finger"))
number = 3
"""


def test_a_task_of_a_file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(FILE)
    assert make_task(f"{path}:stay", robot=FINGER, seconds=0.2).duration == 0.2
    fixed = make_task(f"{path}:FIXED")
    assert fixed == make_task(f"{path}:FIXED", robot=FINGER) and fixed.robot == FINGER
    assert TrackingEnv(f"{path}:stay", robot=FINGER, seconds=0.2).task.option("seconds") == 0.2


@pytest.mark.parametrize(
    ("name", "robot", "message"),
    [
        ("stay", None, "is for any robot: say which"),
        ("FIXED", ARM, "is for robot 'planar_finger', not 'arm'"),
        ("number", FINGER, "must be a Task or a function, got 3"),
        ("nothing", FINGER, "nothing"),
        ("", FINGER, "file.py:name"),
    ],
)
def test_a_file_without_such_a_task_is_reported(name, robot, message, tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(FILE)
    with pytest.raises(ValueError, match=message):
        make_task(f"{path}:{name}", robot=robot)


def test_a_file_that_changed_is_read_again_and_one_that_fails_is_reported(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text("class P:\n    def act(self, observation): return observation\n\none = P()")
    assert make_policy(f"{path}:one", FINGER, 0.01).predict(1)[0] == 1
    path.write_text("1 / 0  # a longer file")
    with pytest.raises(ValueError, match="ZeroDivisionError"):
        make_policy(f"{path}:one", FINGER, 0.01)


# ---------------------------------------------------------------- entry points


PLUGIN = """
def register():
    from softrobot_env import register_policy, register_robot, register_task
    from softrobot_env.robots import ROBOTS, find_robot
    from dataclasses import replace

    print("called with", len(ROBOTS), "robots")
    register_robot(replace(find_robot("planar_finger"), name="plugged"))
    register_task("plugged_task", lambda robot: None)
    register_policy("plugged_policy", "throwaway:P")


class P:
    environment = {"control_period": 0.02}
    def __init__(self, robot, control_period): pass
    def act(self, observation): return observation["reference"]
"""

ASK = """
import sys, warnings
import softrobot_env, softrobot_env.evaluation.runner, softrobot_env.commands.evaluate
assert "throwaway" not in sys.modules, "importing asks no plug-in"
from softrobot_env.robots import find_robot
from softrobot_env.control.registry import make_policy, policy_environment
find_robot("planar_finger")
assert "throwaway" not in sys.modules, "nor does a name that is there"
with warnings.catch_warnings(record=True) as reported:
    warnings.simplefilter("always")
    robot = find_robot("plugged")
    from softrobot_env.tasks import tasks_of
    assert "plugged_task" in list(tasks_of(robot))
    assert policy_environment("plugged_policy") == {"control_period": 0.02}
    assert make_policy("plugged_policy", robot, 0.01).predict({"reference": 5})[0] == 5
print(robot.name, [str(warning.message) for warning in reported])
"""


def test_entry_points_are_called_once_when_a_name_is_missing(tmp_path):
    info = tmp_path / "throwaway-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: throwaway\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[softrobot_env]\na_broken = throwaway:missing\ngood = throwaway:register\n"
    )
    (tmp_path / "throwaway.py").write_text(PLUGIN)
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{ASK}"
    done = finished("-c", code)
    assert done.returncode == 0, done.stderr
    called, answer = done.stdout.splitlines()
    assert called == f"called with {len(EXAMPLES) + 1} robots"
    assert answer.startswith("plugged [") and answer.count("plug-in") == 1
    for text in ("'a_broken' of the package throwaway", "throwaway:missing", "AttributeError"):
        assert text in answer


def test_plugins_are_asked_once(monkeypatch):
    calls = []
    monkeypatch.setattr(registries, "_called", set())
    monkeypatch.setattr(registries, "_entry_points", lambda group: calls.append(1) or [])
    for _ in range(2):
        with pytest.raises(ValueError, match="unknown robot"):
            find_robot("nobody")
    assert calls == [1]
