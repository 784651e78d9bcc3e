"""What the page in the browser simulates, simulated here; `make test-demo` tests the page."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from softrobot_env.core.files import models_dir
from softrobot_env.learned.network import Network
from softrobot_env.tasks import make_task

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def demo():
    spec = importlib.util.spec_from_file_location("demo_script", ROOT / "scripts" / "demo.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_has_the_robots_and_networks_of_now(demo):
    page = json.loads((ROOT / "docs" / "demo" / "robots.json").read_text())
    assert page == json.loads(json.dumps([demo.arm(), demo.rig()]))


def test_networks_and_references_are_those_of_the_package(demo):
    moving = demo.Moving(demo.arm() | {"start": [0.0] * 6})
    network = Network.load(models_dir() / "qs_nn.npz")[0]
    given = np.random.default_rng(0).uniform(*network.inputs.restore(np.array([[-1], [1]])))
    assert moving.evaluated(given) == pytest.approx(network(given[None])[0], rel=1e-12)
    swing = make_task("swing").trajectory
    for time in (0.0, 3.217, 9.5):
        assert moving.reference(time) == pytest.approx(swing.position(time)[[0, 2]], abs=2e-6)


@pytest.mark.slow
def test_both_robots_follow(demo):
    arm, rig = demo.motions([demo.arm(), demo.rig()])
    # Where the arm's path turns back at once its network, five decisions a second, is late by some
    # 25 mm; the rig's, by which it is at rest where it shall be, lags by some 12 mm at 100 mm/s.
    assert arm["largest"] < 0.030 and rig["largest"] < 0.015


def test_a_lap_goes_on_where_it_ended(demo):
    for page in (demo.arm(), demo.rig()):
        approach, lap = page["reference"].values()
        steps = np.linalg.norm(np.diff([*approach, *lap, lap[0]], axis=0), axis=1)
        assert steps.max() < 0.3 * demo.PERIOD  # m, slower than 0.3 m/s at any time
