"""Identifications against truths: arcs, recordings of other robots, and what they leave open."""

from dataclasses import replace
from math import pi
from types import SimpleNamespace

import numpy as np
import pytest
from support.commands import called, rows_in
from support.recorded_rods import LENGTH, real_recording, recorded, rod

from softrobot_env.control.registry import make_policy
from softrobot_env.core.processes import Workers, using
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.identification.errors import size
from softrobot_env.identification.fit import dynamics, path, validation
from softrobot_env.identification.fit.assignment import assigned
from softrobot_env.identification.fit.dynamics import windows_of
from softrobot_env.identification.fit.least_squares import NORMAL_95, clustered, weights_of
from softrobot_env.identification.fit.model import StaticModel
from softrobot_env.identification.fit.path import identify, placed
from softrobot_env.identification.fit.report import write_files
from softrobot_env.identification.fit.residual import corrected, read_residual, trained
from softrobot_env.identification.fit.static_windows import at_rest
from softrobot_env.identification.fit.unknowns import FRICTIONS, HOLDS, RUBS, Fact, Group, Unknowns
from softrobot_env.identification.replay import replay
from softrobot_env.recordings import Frame, Marker, Recording, read_header, write_recording
from softrobot_env.robots import ROBOTS, RobotParams, read_robot, write_robot
from softrobot_env.robots.twin import rig3d_twin
from softrobot_env.tasks import make_task
from softrobot_env.thesis.rig.parameters import identified, record
from studies.truths import capstan_twin

RADIUS, TENDON, MODULUS = 0.004, 0.008, 1e7
BENDING = MODULUS * pi * RADIUS**4 / 4
ROD = rod(RADIUS, TENDON, MODULUS, 1200.0)
HEAVY = replace(ROD, gravity=(0.0, 0.0, -9.81))


def in_turn(robot: RobotParams, levels, kind: str = "tension", begin: float = 0.0) -> Recording:
    """Commands [N] or [m] to one tendon after the other at rest, and no markers yet."""
    names = robot.tendon_names
    rows = np.concatenate([np.outer(levels, one) for one in np.eye(3)]) + begin
    labels = np.repeat([f"pull {name}" for name in names], len(levels))
    return recorded(rows, kind, names, labels=labels)


def pulled(robot: RobotParams, levels: np.ndarray, noise: float = 0.0, *kind) -> Recording:
    """What the MuJoCo chain shows at rest after commands in turn, see `in_turn`."""
    blank = in_turn(robot, levels, *kind)
    seen = replay(blank, robot).simulated
    seen = seen + noise * np.random.default_rng(1).standard_normal(seen.shape)
    return replace(blank, markers=seen)


UP_AND_DOWN = np.concatenate([np.linspace(0.1, 1, 6), np.linspace(0.8, 0.1, 4)])


@pytest.mark.slow
def test_a_tendon_bends_the_model_to_an_arc_and_its_slopes_are_exact():
    robot, levels = ROD, np.linspace(0.1, 1.0, 4)
    model = StaticModel(robot, pulled(robot, levels), known=FRICTIONS)
    x = np.zeros(len(model.unknowns.spread))
    found = model.simulate(x, np.ones(len(x), dtype=bool))
    turn = levels * TENDON * LENGTH / BENDING
    arc = LENGTH / turn * np.stack([1 - np.cos(turn), 0 * turn, np.sin(turn)])
    assert np.abs(found.markers[:4, 0].T - arc).max() < 1e-8
    steps = 1e-6 * model.unknowns.spread
    for k, step in enumerate(steps):
        change = np.eye(len(x))[k] * step
        there, back = model.simulate(x + change).error, model.simulate(x - change).error
        slope = (there - back) / 2 / step
        assert np.abs(slope - found.slopes[..., k]).max() < 1e-5 + 1e-5 * np.abs(slope).max()


def test_slopes_are_exact_where_a_robot_stays_as_it_is():
    """Its tendons are about to slide there, or not: by rounding, but for all parameters alike."""
    robot = ROBOTS["silicone_rod"]
    share = np.array([[0.1, 0, 0], [0.5, 0, -0.1], *[[0.8, 0.1, -0.2]] * 4])
    model = StaticModel(robot, recorded(8e-3 * share, "length", robot.tendon_names))
    x, step = np.zeros(len(model.unknowns.spread)), 1e-7
    found = model.simulate(x, np.ones(len(x), dtype=bool))
    for k, way in enumerate(step * np.eye(len(x))):
        there, back = model.simulate(x + way).error, model.simulate(x - way).error
        assert np.abs((there - back) / 2 / step - found.slopes[..., k]).max() < 1e-4


@pytest.mark.slow
def test_finer_pieces_come_nearer_by_the_square_and_leave_the_chain_alone():
    """Of a heavy rod: its weight bends each piece unlike an arc."""
    robot = HEAVY.vary(density=2.0)
    models = [StaticModel(robot, pulled(robot, np.linspace(0.1, 0.6, 3)), known=FRICTIONS)]
    for _ in range(3):
        models.append(models[-1].finer())
    x = np.zeros(len(models[0].unknowns.spread))
    tips = np.array([model.simulate(x).markers for model in models])
    off = np.abs(tips[:-1] - tips[-1]).max(axis=(1, 2, 3))  # the last is off by a third at most
    assert off[0] > 1e-5
    assert np.all(off[:-1] > 3 * off[1:])
    assert models[-1].robot_of(x).pieces == models[0].robot_of(x).pieces


@pytest.mark.slow
def test_friction_weight_and_modulus_are_found_in_what_the_chain_does():
    """Of a heavy rod whose tendons rub; where friction was is carried from row to row."""
    believed = HEAVY
    true = believed.vary(youngs_modulus=1.3, density=0.8, tendon_friction=0.03)
    recording = pulled(true, UP_AND_DOWN, noise=1e-4)
    found = identify(recording, believed, ("statics",), validate=False)
    names = found.unknowns.labels
    for name, value in (("youngs_modulus: section 1", 1.3), ("mass: all", 0.8)):
        k = names.index(name)
        assert abs(found.fit.x[k] - np.log(value)) < 4 * found.fit.deviation[k] + 0.01
    assert [t.friction for t in found.robot.tendons] == pytest.approx([0.03] * 3, rel=0.1)
    assert size(found.fit.simulated.error) < 4e-4 < 1e-2 < size(replay(recording, believed).error)


@pytest.mark.slow
@pytest.mark.parametrize("held", [0.0, 0.1])
def test_friction_of_the_backbone_is_found_where_there_is_some(held):
    """Of a rod that keeps a bend of `held` [rad]; the other has friction of its tendons alone."""
    most = held * BENDING / LENGTH
    true = replace(ROD, bending_friction=most or None).vary(tendon_friction=0.02)
    recording = pulled(true, np.append(UP_AND_DOWN, 0.0), noise=1e-4)
    found = identify(recording, ROD, ("statics",), validate=False)
    sections = found.robot.backbone.sections
    assert [s.bending_friction for s in sections] == pytest.approx([most], rel=0.1)
    assert [t.friction for t in found.robot.tendons] == pytest.approx([0.02] * 3, rel=0.2)
    assert size(found.fit.simulated.error) < 4e-4


def of_twin(seed: int, rubs: bool = True) -> tuple[float, float, float]:
    """Coefficient of a twin, what is found, and the standard deviation of its logarithm."""
    twin = capstan_twin.seen(seed, rubs)
    found = identify(twin.recording, capstan_twin.BELIEVED, ("statics",), validate=False)
    assert not found.robot.holds
    deviation = found.fit.deviation[found.unknowns.place(RUBS)][0]
    return twin.coefficient, found.robot.tendons[0].friction_coefficient, float(deviation)


@pytest.mark.parametrize(
    ("seeds", "within", "held"),
    [([4, 12], 2, 2), pytest.param(range(100, 140), 36, 36, marks=pytest.mark.slow)],
)
def test_coefficients_of_friction_of_blind_twins_are_found_within_a_tenth(seeds, within, held):
    """Fewer than 36 of 40 intervals that hold 95 % each hold the truth once in 20 tries."""
    true, found, deviation = np.array([of_twin(seed) for seed in seeds]).T
    assert np.sum(np.abs(found / true - 1) < 0.1) >= within
    off = np.abs(np.log(np.maximum(found, 1e-12) / true))
    assert np.sum(off < NORMAL_95 * deviation) >= held


@pytest.mark.parametrize(
    "seeds", [[1], pytest.param(range(200, 220), marks=pytest.mark.slow)], ids=["one", "many"]
)
def test_twins_without_a_coefficient_of_friction_are_told_to_have_none(seeds):
    assert [of_twin(seed, rubs=False)[1] for seed in seeds] == [0.0] * len(seeds)


def test_slopes_by_coefficients_of_friction_are_exact_while_zones_stick_and_slide():
    robot = HEAVY.vary(friction_coefficient=0.2, tendon_friction=0.01)
    ways = np.array([[1, 0, 0.2], [3, 0.5, 0], [2.5, 1.5, 0], [0.5, 1.5, 1], [0.7, 1.2, 1]])
    model = StaticModel(robot, recorded(ways, "tension", robot.tendon_names), known=FRICTIONS)
    x, step = np.zeros(len(model.unknowns.spread)), 1e-7
    found = model.simulate(x, np.ones(len(x), dtype=bool))
    for k, way in enumerate(step * np.eye(len(x))):
        there, back = model.simulate(x + way).error, model.simulate(x - way).error
        slope = (there - back) / 2 / step
        assert np.abs(slope - found.slopes[..., k]).max() < 1e-5 + 1e-4 * np.abs(slope).max()


@pytest.mark.slow
def test_what_is_written_is_what_was_found(tmp_path):
    """Robot file and header make the model, and MuJoCo's chain, do what was fitted."""
    believed = ROBOTS["silicone_rod"]
    frame = Frame(turn_deg=(1.0, -1.0, 0.0), shift_m=(2e-3, -1e-3, 1e-3))
    true = believed.vary(youngs_modulus=0.8, tendon_friction=0.1)
    seen = pulled(true, 8e-3 * UP_AND_DOWN, 0.0, "length", -1e-3)
    recording = replace(seen, markers=frame.to_recorded(seen.markers))
    stages = ("frame", "tendons", "geometry", "statics")
    found = identify(recording, believed, stages, validate=False)
    write_files(found, tmp_path)
    robot, read = read_robot(tmp_path / "robot.toml"), read_header(tmp_path / "recording.toml")
    text = (tmp_path / "robot.toml").read_text()
    assert "# " in text and "youngs_modulus: section 1" in text
    again = placed(recording, read)
    model = StaticModel(robot, again, known=FRICTIONS).finer()  # as it was fitted
    same = model.simulate(np.zeros(len(model.unknowns.spread)))
    assert np.abs(same.markers - found.fit.simulated.markers).max() < 1e-7
    assert size(replay(again, robot).error) < size(found.fit.simulated.error) + 2e-4 < 1e-3


@pytest.mark.slow
def test_backlash_is_found_where_tendons_do_not_rub():
    """Of a robot whose chain has servos with backlash; slopes by it are exact."""
    believed = ROBOTS["silicone_rod"]
    true = replace(believed, drive=replace(believed.drive, backlash=4e-4))
    recording = pulled(true, 8e-3 * UP_AND_DOWN, 0.0, "length")
    found = identify(recording, believed, ("statics",), known=["tendon_friction"], validate=False)
    assert found.robot.drive.backlash == pytest.approx(4e-4, rel=0.05)
    assert size(found.fit.simulated.error) < 4e-4
    model = StaticModel(believed, recording, known=[HOLDS])
    place, x = model.unknowns.place("backlash").start, np.zeros(len(model.unknowns.spread))
    free = np.arange(len(x)) == place
    there, back = (model.simulate(x + free * step).error for step in (1e-5, -1e-5))
    slope = model.simulate(x, free).slopes[..., 0]
    assert np.abs(slope).max() > 1e-5
    assert np.abs((there - back) / 2e-5 - slope).max() < 1e-5 * np.abs(slope).max() + 1e-9


def test_a_column_that_counts_the_other_way_and_a_frame_anywhere_are_found():
    robot = ROBOTS["silicone_rod"]
    seen = pulled(robot, 8e-3 * np.array([0.3, 0.7, 1.0, 0.5]), 0.0, "length")
    header, name = seen.header, robot.tendons[1].name
    frame = Frame(turn_deg=(40, -100, 70), shift_m=(1.2, -0.4, 0.7))
    turned = replace(seen, commands=seen.commands * [1, -1, 1])
    recording = replace(turned, markers=frame.to_recorded(seen.markers))
    found = identify(recording, robot, ("frame", "tendons"), any_turn=True, validate=False)
    assert found.header.commands.factors == (1, -1, 1)
    assert found.header.frame.rotation == pytest.approx(frame.rotation, abs=0.02)
    assert size(found.fit.simulated.error) < 3e-4
    assert f"column {name} counts what is let out" in found.doubts[0]
    with pytest.raises(ValueError, match=r"marker 1 is usually .* mm from the clamp.*--any-turn"):
        identify(recording, robot, validate=False)
    with pytest.raises(ValueError, match="known must be out of frame_turn"):
        identify(seen, robot, known=["weight"], validate=False)
    # A header that says factors is believed, and doubted.
    commands = replace(header.commands, factors=(1.0, 1.0, 1.0))
    said = replace(turned, header=replace(header, commands=commands))
    wrong = identify(said, robot, ("geometry",), validate=False)
    reported = f"column {name} seems to count the other way (commands.factors)"
    assert any(reported in doubt for doubt in wrong.doubts)


def test_an_assignment_that_another_one_equals_is_doubted():
    sure = path.Assignment(("a", "b"), (1.0, 1.0), 0.0, 7e-3, 9e-3, 40)
    assert path._unsure(sure) == () == path._unsure(None)
    (reported,) = path._unsure(replace(sure, second=7.5e-3))
    assert "not sure" in reported and "7.5 mm, this one 7.0 mm" in reported


def fit_that_left(error, slopes=None):
    """A fit that left errors (t, 1, 3), by slopes (3 t, p) of parameters without a prior."""
    known = np.zeros((0, 0)) if slopes is None else 1e6 * slopes.T @ slopes
    weights = SimpleNamespace(deviation=1.0)
    return SimpleNamespace(
        simulated=SimpleNamespace(error=error), information=known, weights=weights
    )


def test_a_deviation_counts_what_parameters_took_of_the_residuals():
    """A quarter of the residuals: their own mean square is too small by as much."""
    rng, rows, noise, found = np.random.default_rng(3), 200, 1e-3, []
    model = SimpleNamespace(recording=SimpleNamespace(runs=np.arange(rows)))  # rows are unrelated
    for _ in range(20):
        slopes = rng.standard_normal((3 * rows, 150))
        seen = noise * rng.standard_normal(3 * rows)
        left = slopes @ np.linalg.lstsq(slopes, seen, rcond=None)[0] - seen
        found.append(weights_of(fit_that_left(left.reshape(rows, 1, 3), slopes), model).deviation)
    # Each is good to 1 / sqrt(2 * 450), the spread by the median to some 5 %.
    assert np.mean(found) == pytest.approx(noise, rel=0.05)


def test_outliers_do_not_hide_how_long_residuals_last():
    rng = np.random.default_rng(0)
    slow = np.convolve(rng.standard_normal(1200), np.ones(12) / np.sqrt(12))[:1000]
    error = 1e-3 * np.tile(slow[:, None, None], (1, 1, 3))
    spoiled = error.copy()
    spoiled[::50] += 0.08 * rng.standard_normal((20, 1, 3))
    model = SimpleNamespace(recording=SimpleNamespace(runs=np.zeros(1000, dtype=int)))
    clean, other = (weights_of(fit_that_left(e), model) for e in (error, spoiled))
    assert 8 < clean.correlation < 16
    assert other.correlation > 0.75 * clean.correlation
    assert other.scale < 1.3 * clean.scale


def test_facts_are_weighed_against_the_file_as_bayes_says():
    unknowns = Unknowns((Group("a", "statics", ("1", "2"), 0.3, "log", 0.4),))
    weights = unknowns.common("a")
    combined = replace(
        unknowns, facts=(Fact(weights, 0.5, 0.2), Fact(np.array([1.0, -1]), 0.1, 0.1))
    )
    rows = np.array([weights, [1.0, -1.0]])
    precise = np.diag([0.2**-2, 0.1**-2])
    covariance = np.linalg.inv(np.linalg.inv(unknowns.prior) + rows.T @ precise @ rows)
    assert combined.prior == pytest.approx(covariance)
    assert combined.mean == pytest.approx(covariance @ rows.T @ precise @ [0.5, 0.1])
    assert not unknowns.mean.any()


@pytest.mark.slow
def test_a_twin_that_nobody_told_is_identified_and_driven():
    """The camera sees no height; servos have backlash and zeros, tendons rub, turned and unlike."""
    twin = rig3d_twin(11)
    found = identified(record(twin, 3))
    tendons = zip(twin.robot.tendons, found.robot.tendons, strict=True)
    turns = [np.angle(complex(*b.offset) / complex(*a.offset)) for a, b in tendons]
    assert np.abs(np.degrees(turns)).max() < 1.5  # of 7 degrees
    assert found.robot.drive.backlash == pytest.approx(np.mean(twin.backlash), rel=0.35)
    law = make_policy("chain_dynamics_pi", found.robot, 0.02, tip_delay=twin.camera_delay)
    case = Case(make_task("triangle", period=5.0), "chain_dynamics_pi", scene={"twin": twin})
    error = {}
    for name, policy in (("found", law), ("believed", None)):
        env = case.environment()
        error[name] = run(case, env, policy).row().e_mean
        env.close()
    assert error["found"] < 0.7 * error["believed"]


def test_markers_that_were_lost_say_nothing_of_a_motion(monkeypatch):
    """Where half of the rows are lost, a delay is known root two times worse, errors are alike."""
    rows, rng = 400, np.random.default_rng(0)
    times = 1e-3 * np.arange(rows)
    noise, way = 1e-3 * rng.standard_normal((rows, 1, 3)), np.sin(40 * times)[:, None, None]
    marker = Marker("x", "y", "z", may_be_lost=True)
    moving = recorded(np.ones((rows, 3)), times=times, marker=marker, rate_Hz=1e3)
    half = np.where(np.arange(rows)[:, None, None] % 2, np.nan, noise)

    def found(noise: np.ndarray) -> dynamics.Dynamics:
        def shown(moved: Recording, robot: RobotParams) -> SimpleNamespace:
            late = moved.header.marker[0].delay_s - 0.02
            return SimpleNamespace(error=noise + 5e-3 * late * way)

        monkeypatch.setattr(dynamics, "replay", shown)
        return dynamics.dynamics_of(ROD, moving)

    every, some = found(noise), found(half)
    assert some.after == pytest.approx(every.after, rel=0.1)
    assert some.deviation[1] == pytest.approx(2**0.5 * every.deviation[1], rel=0.15)


@pytest.mark.slow
def test_columns_in_another_order_and_a_turned_frame_are_told_apart():
    robot = HEAVY
    recording = pulled(robot, np.linspace(0.1, 1.0, 4))
    order, turn = (2, 0, 1), 0.7
    commands = replace(recording.header.commands, columns=("a", "b", "c"), tendons=None)
    markers = Frame(turn_deg=(0, 0, np.degrees(turn))).to_recorded(recording.markers)
    unknown = replace(
        recording,
        header=replace(recording.header, commands=commands),
        commands=recording.commands[:, order],
        markers=markers,
    )
    found = assigned(unknown, robot)
    # Turned on by a third they are the same robot in a frame that is turned by a third.
    places = [int(name[1:]) for name in found.tendons]
    assert [(a - b) % 3 for a, b in zip(places, order, strict=True)] == [(places[0] - 2) % 3] * 3
    third = 2 * np.pi / 3 * ((places[0] - 2) % 3)
    assert np.cos(found.turn - turn - third) == pytest.approx(1, abs=1e-4)
    assert found.signs == (1, 1, 1) and found.rms < 2e-3 < found.second
    with using(Workers(2)):
        assert assigned(unknown, robot) == found


@pytest.mark.slow
def test_further_starts_find_in_processes_what_they_find_in_this_one(monkeypatch):
    robot = ROD
    recording = pulled(robot.vary(youngs_modulus=1.3), np.linspace(0.1, 1.0, 4), noise=1e-4)
    # Nothing is good enough, so that the further starts are taken.
    monkeypatch.setattr(path, "size", lambda error: 1.0 + size(error))
    alone = identify(recording, robot, ("statics",), validate=False)
    with using(Workers(2)):
        shared = identify(recording, robot, ("statics",), validate=False)
    np.testing.assert_array_equal(shared.fit.x, alone.fit.x)
    np.testing.assert_array_equal(shared.fit.covariance, alone.fit.covariance)


@pytest.mark.slow
def test_what_the_data_cannot_tell_is_named():
    """A weightless robot driven by length bends alike whatever its modulus, beside the tendons'."""
    robot = replace(ROBOTS["silicone_rod"], gravity=(0.0, 0.0, 0.0))
    recording = pulled(robot, 6e-3 * UP_AND_DOWN, 0.0, "length")
    found = identify(recording, robot, ("statics",), validate=False)
    nothing = [one for one in found.combinations if one.information < 1e-6]
    named = {name.split(":")[0] for one in nothing for name, _ in one.parts}
    assert {"youngs_modulus", "tendon_stiffness"} <= named


@pytest.mark.slow
def test_a_residual_is_zero_far_from_the_data_and_survives_a_file(tmp_path):
    rng = np.random.default_rng(0)
    bends = np.cumsum(0.05 * rng.standard_normal((200, 2)), axis=0)
    commands, begins = 3.0 * bends, np.arange(200) == 0
    error = 1e-3 * np.stack([np.sin(3 * bends[:, 0]), bends[:, 1], 0 * bends[:, 0]], axis=1)
    learned = trained(bends, commands, begins, error[:, None], np.arange(200) // 10)
    assert learned is not None
    left = error[:, None] + learned.correction(bends, commands, begins)
    assert size(left) < 0.3 * size(error[:, None])
    far = learned.correction(bends + 100.0, commands + 300.0, begins)
    assert not far.any()
    learned.save(tmp_path / "residual.npz")
    again = read_residual(tmp_path / "residual.npz")
    assert np.array_equal(again.correction(bends, commands, begins) + error[:, None], left)
    noise = 1e-3 * rng.standard_normal((200, 1, 3))
    assert trained(bends, commands, begins, noise, np.arange(200) // 10) is None


def test_rests_are_the_ends_of_times_without_a_command():
    times = np.arange(1200) * 0.01
    level = times // 1.0
    commands = np.stack([level, 0 * level], axis=1)
    sway = np.exp(-8 * (times % 1.0)) * np.cos(30 * times)
    markers = np.stack([level + 0.2 * sway, 0 * level, 0 * level], axis=1)[:, None]
    moving = recorded(commands, names="ab", markers=markers, times=times, rate_Hz=100.0)
    windows = at_rest(moving)
    assert windows.static and windows.commands[:, 0].tolist() == list(range(12))
    # It jumped to all but the first: tendons come to rest anywhere, and the markers do not count.
    assert windows.runs.tolist() == list(range(12)) and np.isnan(windows.markers[1:]).all()
    # What is read with another header keeps what was lost.
    again = placed(windows, replace(moving.header, static=True))
    assert np.array_equal(again.markers, windows.markers, equal_nan=True)
    with pytest.raises(ValueError, match="rests 7 times in the recording, fewer than 8: record"):
        at_rest(moving.part(slice(0, 700)))


def test_windows_of_motion_are_whole_decays_led_by_the_pull_before():
    rise = np.linspace(0, 1, 91)[1:]
    cycle = np.concatenate([rise, np.ones(40), np.zeros(120)])  # pulled, held, let go
    level = np.concatenate([np.zeros(40), np.tile(cycle, 6)])
    times = 0.01 * np.arange(len(level))
    markers = np.stack([np.append(0.0, level[:-1]), 0 * level, 0 * level], axis=1)[:, None]
    moving = recorded(level[:, None], names="a", markers=markers, times=times, rate_Hz=100.0)
    windows = windows_of(moving)
    assert np.bincount(windows.runs).tolist() == [250] * 5  # 12 s at most
    for number in range(5):
        mine = windows.runs == number
        seen = np.isfinite(windows.markers[mine, 0, 0])
        assert np.array_equal(windows.commands[mine][:131, 0], np.append(0.0, cycle[:130]))
        assert not seen[:130].any() and seen[130:].all()


@pytest.mark.slow
def test_blocks_left_out_are_alike_in_processes_and_predicted_worse_than_fitted(monkeypatch):
    recording = pulled(HEAVY.vary(tendon_friction=0.02), UP_AND_DOWN, 1e-4)
    here = identify(recording, HEAVY, ("statics",))
    monkeypatch.setattr(validation, "_LONG", 0)
    there = identify(recording, HEAVY, ("statics",))
    assert np.array_equal(here.validation.error, there.validation.error)
    assert np.array_equal(here.fit.x, there.fit.x)
    assert size(here.validation.error) > size(here.fit.simulated.error)


@pytest.mark.slow
def test_the_command_writes_what_a_replay_reads(tmp_path, capsys):
    true, out = HEAVY.vary(youngs_modulus=1.2), tmp_path / "found"
    pulls = tmp_path / "pulls.csv"
    write_recording(pulled(true, UP_AND_DOWN, 1e-4), pulls)
    write_robot(HEAVY, tmp_path / "rod.toml")
    words = "--stages statics --known mass --no-plots --out"
    assert called("identify", pulls, "--robot", tmp_path / "rod.toml", words, out) == 0
    said = capsys.readouterr().out
    assert "chain" in said and "What would tell more" in said
    found = {r["parameter"]: r for r in rows_in(out) if r["kind"] == "parameter"}
    modulus = found["youngs_modulus: section 1"]
    assert modulus["value"] == pytest.approx(np.log(1.2), abs=0.02)
    assert modulus["low"] < modulus["value"] < modulus["high"]
    given = ("--no-plots --robot", out / "robot.toml", "--out", tmp_path / "replay")
    assert called("recording replay", pulls, *given) == 0
    assert rows_in(tmp_path / "replay")[0]["rms"] < 1e-3
    (interval,) = (row for row in rows_in(out) if row["kind"] == "prediction")
    assert 1e-4 < interval["near"] <= interval["far"] < 2e-3
    assert "95 % interval by the identification: " in capsys.readouterr().out


@pytest.mark.slow
def test_the_real_robot_is_identified(tmp_path):
    """Of its first 400 rows: pulls and the base section; the whole recording takes minutes."""
    path = real_recording("ftdcr_v4/train.csv")
    from softrobot_env.core.files import assets_dir
    from softrobot_env.recordings import read_recording

    whole = read_recording(path, assets_dir() / "recordings" / "ftdcr_v4.toml")
    recording = whole.part(slice(0, 700))
    found = identify(recording, ROBOTS["ftdcr_v4"], validate=False)
    # Which of the three tendons of a section is the first depends on how the frame is turned.
    pairs = zip(recording.header.commands.columns, found.assignment.tendons, strict=True)
    sections = {column: tendon[:8] for column, tendon in pairs}
    for k, ids in enumerate(((4, 3, 9), (5, 2, 8), (6, 1, 7)), 1):
        assert {sections[f"servo_{i}_mm"] for i in ids} == {f"section{k}"}
    assert size(found.fit.simulated.error) < 6e-3
    again = placed(whole, found.header)
    assert size(replay(again, found.robot).error) < 12e-3  # most patterns it has not seen
    write_files(found, tmp_path)
    # A correction is written where one helps on patterns that it has not seen.
    assert (tmp_path / "residual.npz").is_file() == (found.residual is not None)
    if found.residual is not None:
        robot, part = read_robot(tmp_path / "robot.toml"), placed(recording, found.header)
        change = corrected(read_residual(tmp_path / "residual.npz"), robot, part)
        error = replay(part, found.robot).error
        assert size(error + change) < size(error)


@pytest.mark.parametrize("lacking", [0.0, 0.3])
def test_intervals_hold_the_truth_also_where_the_model_lacks_something(lacking):
    """Lines through few runs, each with a slope of its own about the common one."""
    rng, inside, noise, count = np.random.default_rng(0), [], 0.1, 6
    runs, times = np.repeat(np.arange(count), 20), np.tile(np.linspace(0, 1, 20), count)
    slopes = times[:, None]
    normal = slopes.T @ slopes / noise**2
    for _ in range(400):
        own = lacking * rng.standard_normal(count)[runs]
        seen = (2 + own) * times + noise * rng.standard_normal(len(runs))
        found = np.linalg.lstsq(slopes, seen, rcond=None)[0]
        covariance = clustered(slopes, slopes @ found - seen, normal, noise**2, runs)
        inside.append(abs(found[0] - 2) < NORMAL_95 * covariance[0, 0] ** 0.5)
    # 400 draws of 95 % scatter by 1.1 %; noise counts twice where nothing lacks.
    assert np.mean(inside) > 0.92
    if lacking:
        assert np.mean(inside) < 0.99
