"""One file from outside adds a part of the package, for single environments and for many.

Each file of `tests/outside` has a function `register`, as a package names it in the entry-point
group, and at most 60 lines; `CHECKS` says what must hold of it.
"""

import json
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from softrobot_env.cli import main
from softrobot_env.core.registry import Registry, load
from softrobot_env.core.studies import BENCHMARKS
from softrobot_env.envs.observations.table import OBSERVABLES
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.rewards import REWARDS, TERMS
from softrobot_env.robots.variations import VARIATIONS

FILES = sorted((Path(__file__).parent / "outside").glob("*.py"))
REGISTRIES: tuple[Registry, ...] = (VARIATIONS, OBSERVABLES, REWARDS, BENCHMARKS)

#: A robot that hangs in gravity.
HANGING = {"robot": "hanging_trunk", "task": "circle", "observe": "all"}


@pytest.fixture(autouse=True)
def as_before():
    """Registries as they were."""
    before = [dict(registry.registered()) for registry in REGISTRIES]
    yield
    for registry, entries in zip(REGISTRIES, before, strict=True):
        registry._own.clear()
        registry._own.update(entries)


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
    ranges = Randomization(gravity=(2.0, 2.0))
    for _, single, many in both(randomization=ranges, **HANGING):
        assert single[-1]["variation_gravity"] == 2.0
        np.testing.assert_array_equal(many[-1]["variation_gravity"], [2.0, 2.0])
        np.testing.assert_array_equal(many[0]["tip_position"][1], single[0]["tip_position"])
    command = "evaluate --robot hanging_trunk --tasks circle --policies static --duration 0.05"
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
    rows = json.loads((out / "report.json").read_text())["rows"]
    assert [row["share"] for row in rows] == [0.5, 1.0] * 2
    before = (out / "lengths.png").read_bytes()
    assert main([*words, "--redraw"]) == 0 and (out / "lengths.png").read_bytes() == before
    assert main([*words, "--quick", "--overwrite"]) == 0
    assert len(json.loads((out / "report.json").read_text())["rows"]) == 2


CHECKS: dict[str, Callable[[Path, Path], None]] = {
    "study": check_study,
    "variation": check_variation,
    "observable": check_observable,
    "reward": check_reward,
}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_one_file_adds_a_part(path, tmp_path):
    assert len(path.read_text().splitlines()) <= 60
    load(f"{path}:register")()
    CHECKS[path.stem](path, tmp_path)
