"""The rig in the stability benchmark: its motions, its verdicts, and the timestep rule on it."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from softrobot_env.robots import RIG, SERVO_SPEED
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.timestep import stability_limit
from studies.stability.rig import (
    DURATION,
    MAP,
    MOTIONS,
    PERIOD,
    RULE,
    TRUSTED,
    Variation,
    judged,
    reference,
    run,
)
from studies.stability.runs import (
    DIVERGED,
    NO_TRUTH,
    STABLE,
    WRONG,
    ChainSystem,
    Plan,
    Reference,
    Trace,
    rule_choice,
)

pytestmark = pytest.mark.slow  # a study; the quick suite has what it stands on

JOINTS = 4


# ------------------------------------------------------------- rigs and motions


def test_variation_changes_what_it_says():
    robot = Variation(1e4, 0.5, 0.1, 10.0, 0.3).robot()
    assert robot.bending_stiffness == pytest.approx(0.5 * RIG.bending_stiffness)
    assert robot.damping_time == pytest.approx(0.1 * RIG.damping_time)
    for tendon in robot.tendons:
        assert (tendon.stiffness, tendon.pretension, tendon.friction) == (9.8e6, 10.0, 0.3)
    assert Variation().robot() == RIG


@pytest.mark.parametrize("name", MOTIONS)
def test_servos_wind_at_their_speed_and_return(name):
    path = np.array([MOTIONS[name](k * PERIOD) for k in range(round(DURATION / PERIOD))])
    speed = np.abs(np.diff(path, axis=0, prepend=np.zeros((1, 3)))) / PERIOD
    assert np.max(speed) == pytest.approx(SERVO_SPEED)
    np.testing.assert_allclose(path[-1], 0, atol=1e-15)
    np.testing.assert_allclose(path[19].sum(), 0, atol=1e-15)  # a bend pulls in what it lets out


@pytest.mark.parametrize("tendons", [1.0, 1e4])
def test_slack_tendons_carry_exactly_nothing(tendons):
    system = Variation(tendons, motion="slack").system(JOINTS)
    trace = system.run(Plan("implicitfast", 2e-4, 8000, PERIOD))
    let_out = (trace.time > 0.7) & (trace.time < 0.79)
    assert trace.failure is None
    assert np.all(trace.tension[let_out] == 0)
    assert np.max(trace.tension[trace.time < 0.4]) > 1


def test_traces_of_the_spatial_chain_have_three_coordinates():
    trace = Variation().system(JOINTS).run(Plan("implicitfast", PERIOD, 3, PERIOD))
    np.testing.assert_allclose(trace.tip[0], [0, 0, RIG.reach], atol=1e-15)
    assert trace.tip.shape == (4, 3)


# ------------------------------------------------------------- the linear limit


def free_swing(tendons, ratio):
    """Largest deflection [m] of the undamped weightless rig, nudged, over timesteps / limit."""
    robot = replace(Variation(tendons, 1.0, 0.0, 10.0).robot(), gravity=(0.0, 0.0, 0.0))
    config = SceneConfig(
        robot, pieces=2, actuation="length", bending="spatial", control_period=PERIOD
    )
    nudge = 1e-7 * np.random.default_rng(0).normal(size=2 * JOINTS)
    system = ChainSystem(config, nudge, np.zeros(3))
    limit = stability_limit("implicitfast", system.linear)
    assert limit == pytest.approx(2 / system.linear.frequencies()[-1], rel=1e-6)
    trace = system.run(Plan("implicitfast", ratio * limit, 800, ratio * limit))
    return np.max(np.abs(trace.tip[:, :2]))


@pytest.mark.parametrize("tendons", [1.0, 1e2, 1e4])
def test_undamped_rig_grows_from_two_over_the_highest_frequency_on(tendons):
    """The textbook limit of semi-implicit Euler, for tendons that stay taut."""
    assert free_swing(tendons, 0.97) < 1e-5
    assert free_swing(tendons, 1.03) > 1e-4


def test_stiffer_tendons_lower_the_limit():
    limits = [
        stability_limit("implicitfast", Variation(c).system(JOINTS).linear) for c in (1, 1e2, 1e4)
    ]
    assert limits[0] > 3 * limits[1] > 9 * limits[2]


# ------------------------------------------------------------- verdicts


@pytest.fixture(scope="module")
def steel():
    rig = Variation(1e4)
    system = rig.system(JOINTS)
    return rig, system, reference(rig, system)


def test_chattering_tensions_are_wrong_though_the_tip_is_right(steel):
    limit = stability_limit("implicitfast", steel[1].linear)
    row = run(*steel, "implicitfast", PERIOD / np.floor(PERIOD / (1.5 * limit)), MAP)
    assert row.outcome == WRONG
    assert row.e_max < row.e_bound
    assert row.e_tension > 5
    assert "tensions" in row.failure


def test_divergence_is_named(steel, capfd):
    row = run(*steel, "RK4", PERIOD, MAP)
    assert (row.outcome, row.stable, row.e_max) == (DIVERGED, False, None)
    assert row.failure.startswith("diverged at t = ")
    assert "MuJoCo" not in "".join(capfd.readouterr())


def test_nothing_is_judged_by_refined_runs_that_differ():
    time = np.linspace(0, 1, 20)
    still = Trace(time, np.zeros((20, 3)), None, None, 0.0, 20, np.zeros((20, 3)))
    truth = Reference(still.time, still.tip, 0.5 * TRUSTED, still.tension)
    assert judged(still, truth)[0].outcome == STABLE
    for uncertainty in (2 * TRUSTED, inf):
        verdict, error = judged(still, replace(truth, uncertainty=uncertainty))
        assert (verdict.outcome, verdict.e_max, error) == (NO_TRUTH, None, None)
    gone = replace(still, outcome=DIVERGED, failure="diverged at t = 1 s")
    assert judged(gone, replace(truth, uncertainty=inf))[0].outcome == DIVERGED


def test_undamped_rig_with_stiff_tendons_has_no_truth():
    rig = Variation(1e2, damping=0.0)
    assert reference(rig, rig.system(JOINTS)).uncertainty > TRUSTED
    nylon = Variation(1.0, damping=0.0)
    assert reference(nylon, nylon.system(JOINTS)).uncertainty < TRUSTED / 10


# ------------------------------------------------------------- the rule


RIGS = [
    Variation(),
    Variation(1e-2),
    Variation(1e2, motion="slack", pretension=0.0),
    Variation(1e4, pretension=10.0),
    Variation(1e4, damping=0.1, motion="slack"),
    Variation(1.0, 100.0),
    Variation(1.0, damping=0.0),
    Variation(friction=0.3),
]


@pytest.mark.parametrize("rig", RIGS, ids=str)
def test_rule_keeps_the_rig_stable(rig):
    system = rig.system(JOINTS)
    choice = rule_choice(system, friction=rig.friction > 0)
    row = run(rig, system, reference(rig, system), choice.integrator, choice.timestep, RULE)
    assert row.stable, row.failure
    assert row.uncertainty < TRUSTED


# ------------------------------------------------------------- rows, tables, picture
