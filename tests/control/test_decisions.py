"""Decisions of policies: those of networks against their plain formulas, and their time."""

import json
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from time import thread_time

import numpy as np
import pytest

from softrobot_env.control import memoryless
from softrobot_env.control.learned import neural
from softrobot_env.control.registry import EVERY_POLICY, POLICIES, installed_policies, make_policy
from softrobot_env.core.files import models_dir
from softrobot_env.learned.network import Network, Scaling, initial_network
from softrobot_env.robots import ARM
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.thesis.arm.qs_nn import QuasiStaticNetwork
from studies.speed import measure_afresh, robot_rows

#: Of the arm: 6 of the error and velocity, 8 ahead, 12 of the curvatures, 3 inputs.
FEATURES = 29

NETWORKS = ("imitation", "ppo", "sac", "ppo_randomized", "sac_randomized")


def draw(policy, count, spread=1.0, seed=0):
    """Stacked observations anywhere, in reach and out of it, within the limits and beyond."""
    rng = np.random.default_rng(seed)
    units = {"curvature": 4.0, "curvature_rate": 30.0, "previous_action": 1.1}
    return {
        name: spread * units.get(name, 0.4) * rng.uniform(-1, 1, (count, policy.sizes[name]))
        for name in policy.requires
    }


def row(observation, i):
    return {name: values[i] for name, values in observation.items()}


def neural_formula(network, seen):
    """Action and status of one observation, by the definitions."""
    reference, before = seen["reference"], np.clip(seen["previous_action"], -1, 1)
    error = reference - seen["tip_position"]
    ahead = [point - reference for point in seen["reference_preview"].reshape(-1, 2)]
    parts = [
        error / 0.05,
        np.arcsinh(error / 0.001) / 2,
        seen["reference_velocity"] / 0.1,
        np.ravel(ahead) / 0.02,
        seen["curvature"] / 3,
        seen["curvature_rate"] / 20,
        seen["previous_action"] / 0.15,
    ]
    features = np.clip(np.concatenate(parts), -10, 10).astype(np.float32)
    output = np.clip(network(features.astype(float)[None])[0], -1, 1)
    wanted = before + 0.01 * np.sinh(np.arcsinh(100.0) * output)
    status = "tension limit reached" if np.any(np.abs(wanted) > 1) else None
    far = np.linalg.norm(reference) > ARM.length
    return np.clip(wanted, -1, 1), "reference out of reach" if far else status


def qs_formula(network, workspace, seen):
    """As `neural_formula`, of the quasi-static network."""
    scale, target = TendonMap(ARM).input_scale, seen["reference_preview"]
    inputs = np.concatenate([seen["tip_position"], target, scale * seen["previous_action"]])
    wanted = network(inputs[None])[0] / scale
    turn = (np.arctan2(target[0], target[1]) + np.pi) / (2 * np.pi)
    nearest, farthest = workspace[min(int(turn * len(workspace)), len(workspace) - 1)]
    inside = nearest - 1e-3 <= np.linalg.norm(target) <= farthest + 1e-3
    said = [] if inside else ["outside the trained workspace"]
    said += ["tension limit reached"] if np.any(np.abs(wanted) > 1) else []
    return np.clip(wanted, -1, 1), ", ".join(said) or None


@pytest.fixture(params=[True, False], ids=["compiled", "plain"])
def numba_loaded(request, monkeypatch):
    """Which function the policies take that are made in a test."""
    monkeypatch.setattr(memoryless, "numba_is_loaded", lambda: request.param)
    return request.param


@pytest.mark.parametrize("name", [*NETWORKS, "qs_nn"])
def test_networks_decide_by_their_formula(name, numba_loaded):
    policy = make_policy(name, ARM, 0.2 if name == "qs_nn" else 0.01)
    network, about = Network.load(models_dir() / f"{name}.npz")
    seen, statuses = draw(policy, 200), set()
    for i in range(200):
        action, state = policy.predict(row(seen, i), None)
        if name == "qs_nn":
            wanted, status = qs_formula(network, about["workspace"], row(seen, i))
        else:
            wanted, status = neural_formula(network, row(seen, i))
        # Features are rounded to float32, as actions are.
        np.testing.assert_allclose(action, wanted, atol=2e-6)
        assert state.status == status
        statuses.add(status)
    assert len(statuses) >= 3  # the draw covers what can be said


@pytest.mark.parametrize("name", ["imitation", "sac", "qs_nn"])
def test_stacked_decisions_are_the_single_ones(name, numba_loaded):
    """Those of float32 and strided observables as well; what is not finite is told of its own."""
    policy = make_policy(name, ARM, 0.2 if name == "qs_nn" else 0.01)
    seen = draw(policy, 9)
    seen["tip_position"][4] = np.nan
    seen["previous_action"][6, 1] = np.inf
    seen = {key: np.asfortranarray(value) for key, value in seen.items()}
    actions, states = policy.predict(seen, None)
    narrow, _ = policy.predict({key: value.astype(np.float32) for key, value in seen.items()})
    for i in range(9):
        action, state = policy.predict(row(seen, i), None)
        np.testing.assert_allclose(actions[i], action, atol=1e-7)  # plain: BLAS sums in any order
        assert states[i].status == state.status
    np.testing.assert_allclose(narrow, actions, atol=1e-3)
    assert states[4].status == "observation not finite: tip_position"
    assert states[6].status == "observation not finite: previous_action"
    np.testing.assert_allclose(
        actions[6][[0, 2]], np.clip(seen["previous_action"][6, [0, 2]], -1, 1)
    )
    assert actions[6][1] == 0.0


def test_environments_that_began_at_other_times_decide_in_their_own(numba_loaded):
    """Of every other environment the episode begins between two decisions of the others."""
    policy = make_policy("imitation", ARM, 0.005)
    assert policy.hold == 2
    alone, stacked, single = None, None, None
    for k in range(7):
        seen = draw(policy, 3, seed=k)
        start = np.array([k == 0, k == 3, k == 0])
        actions, stacked = policy.predict(seen, stacked, start)
        wanted, alone = policy.predict(row(seen, 0), alone)
        np.testing.assert_allclose(actions[0], wanted, atol=1e-7)
        wanted, single = policy.predict(row(seen, 1), single, start[1:2])
        np.testing.assert_allclose(actions[1], wanted, atol=1e-7)
        actions += 1.0  # the caller's own


def test_policies_take_the_function_of_the_process_they_are_unpickled_in(monkeypatch):
    policy = make_policy("imitation", ARM, 0.01)
    seen = row(draw(policy, 1), 0)
    wanted, _ = policy.predict(seen)
    kept = pickle.dumps(policy)
    monkeypatch.setattr(memoryless, "numba_is_loaded", lambda: False)
    monkeypatch.setattr(neural.NeuralPolicy, "compiled", None)
    np.testing.assert_allclose(pickle.loads(kept).predict(seen)[0], wanted, atol=1e-7)


def test_hidden_layers_that_compute_no_number_are_reported(numba_loaded):
    """A neuron that is no number must not pass for a saturated one."""
    ends = [Scaling(-np.ones(n), np.ones(n)) for n in (FEATURES, 3)]
    network = initial_network((4, 4), *ends, np.random.default_rng(2))
    bad = (np.full_like(network.weights[0], np.nan), *network.weights[1:])
    policy = neural.NeuralPolicy(ARM, 0.01, replace(network, weights=bad))
    _, state = policy.predict(row(draw(policy, 1), 0))
    assert state.status == "computation not finite"


def test_an_observable_that_changes_its_size_is_refused():
    policy = QuasiStaticNetwork(ARM, 0.2)
    seen = row(draw(policy, 1), 0)
    _, state = policy.predict(seen)
    with pytest.raises(ValueError, match="changed its size"):
        policy.predict({**seen, "previous_action": np.zeros(2)}, state)


# ---------------------------------------------------------------- imports and time


def test_policies_of_networks_and_what_environments_they_need_come_without_numba():
    code = f"""
import sys
import numpy as np
from softrobot_env.control.registry import EVERY_POLICY, make_policy, policy_environment
from softrobot_env.robots import ARM
for name in EVERY_POLICY:
    policy_environment(name)
    assert "numba" not in sys.modules, name
import softrobot_env.evaluation.runner, softrobot_env.learned.plain_inference
for name in {[*NETWORKS, "qs_nn", "hold"]}:
    policy = make_policy(name, ARM, 0.01)
    one = {{key: np.zeros(policy.sizes.get(key, 3)) for key in policy.requires}}
    policy.predict(one)
    policy.predict({{key: np.stack([value] * 3) for key, value in one.items()}})
    assert "numba" not in sys.modules, name
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert not done.returncode, done.stderr


@pytest.mark.parametrize("name", ["imitation", "ppo"])
def test_many_decisions_take_far_less_than_so_many_calls(name):
    policy = make_policy(name, ARM, 0.01)
    many = draw(policy, 256)
    one = row(many, 0)

    def least(observation, calls):
        times = []
        for _ in range(calls):
            begin = thread_time()
            policy.predict(observation, None)
            times.append(thread_time() - begin)
        return min(times)

    assert least(many, 10) < 150 * least(one, 200)


@pytest.fixture(scope="module")
def slowness():
    """Time of a step of the arm here over that in the committed report; at least 1."""
    here = robot_rows(True)[0]
    report = Path(__file__).parents[2] / "docs/results/speed/report.json"
    rows = json.loads(report.read_text())["rows"]
    there = next(r for r in rows if (r["what"], r["variant"]) == (here.what, here.variant))
    return max(1.0, here.seconds / there["seconds"])


@pytest.mark.slow
@pytest.mark.parametrize("name", list(EVERY_POLICY))
def test_no_decision_of_5000_is_longer_than_its_control_period(name, slowness):
    if name in POLICIES and name not in installed_policies():
        pytest.skip("needs the extra mpc")
    # What compiles, loads or iterates for long does so in every process; pauses of a busy virtual
    # machine, which count as computing, do not come back. A machine slower than that of the
    # report may take longer by as much.
    runs = (measure_afresh(name) for _ in range(3))
    assert any(run["longest"] < run["period"] * slowness for run in runs)
