"""Metrics, labels and plots of episodes of the spatial test rig, of records made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from support.rollouts import made_rollout

from softrobot_env.evaluation.metrics import approached_metrics
from softrobot_env.evaluation.report import identified_label, option_columns, rig_label, task_label
from softrobot_env.evaluation.runner import Case, Outcome
from softrobot_env.rendering import episodes
from softrobot_env.rendering.plots import plot_task
from softrobot_env.tasks import make_task

TASK = make_task("triangle", period=1.0)


def record(task, duration, failure=None):
    """The tip is 3 mm off until 10 s, then 4 mm in x, and 4 and 3 mm in both from 12 s on."""
    time = np.arange(0, duration + 0.01, 0.02)
    off = np.where(time[:, None] <= 10.0, [3e-3, 0, 0], [4e-3, 0, 0])
    off[time > 12.0] = [4e-3, 3e-3, 0]
    reference = task.trajectory.position(time)
    return made_rollout(time, reference, reference + off, failure=failure)


def test_errors_of_the_approach_do_not_count():
    values = approached_metrics(record(TASK, 14.0), TASK.trajectory)
    assert values.e_max_tracking == pytest.approx(5e-3)
    assert values.e_mean_tracking == pytest.approx(4.5e-3)  # 2 s at 4 mm, 2 s at 5 mm


@pytest.mark.parametrize(
    ("task", "duration"), [(TASK, 9.0), (make_task("reach"), 14.0), (make_task("swing"), 14.0)]
)
def test_without_what_follows_an_approach_there_is_no_tracking_error(task, duration):
    values = approached_metrics(record(task, duration), task.trajectory)
    assert values.e_mean_tracking is values.e_max_tracking is None


@pytest.mark.parametrize(
    ("name", "options", "label"),
    [
        ("triangle", {"period": 5.0}, "triangle 5 s"),
        ("rig_circle", {"radius": 0.12, "speed": 0.05}, "rig_circle 120 mm 0.05 m/s"),
        ("reach", {"seed": 1, "radius": 0.1, "hold": 3.0}, "reach 1 100 mm 3 s"),
        ("random", {"speed": 0.1, "seed": 2}, make_task("random", seed=2).label),
        ("step", {"step_width": 0.1}, make_task("step", 0.1).label),
    ],
)
def test_labels_tell_the_options_of_a_task(name, options, label):
    assert task_label({"task": name, **option_columns(options)}) == label


@pytest.mark.parametrize(
    ("task", "plant", "twin", "label"),
    [
        ("triangle", "mujoco", 3, "twin 3"),
        ("triangle", "mujoco", None, "ideal"),
        ("triangle", "real", None, "real"),
        ("swing", "mujoco", None, ""),
    ],
)
def test_labels_tell_which_rig_it_was(task, plant, twin, label):
    assert rig_label({"task": task, "plant": plant, "twin": twin}) == label


def row(rollout, **changes):
    values = vars(Outcome(Case(TASK, "hybrid"), rollout, 0.02).row())
    return values | {"period": 1.0, "twin": 0} | changes


def test_one_rig_stands_in_the_title_and_several_in_a_column():
    rows = [row(record(TASK, 14.0)), row(record(TASK, 14.0), twin=3)]
    (alone,) = episodes.tables(rows[:1])
    assert str(alone.title) == "triangle 1 s, twin 0"
    (both,) = episodes.tables(rows)
    assert str(both.title) == "triangle 1 s"
    assert [str(column.header) for column in both.columns][:2] == ["policy", "rig"]
    assert list(map(str, both.columns[1].cells)) == ["twin 0", "twin 3"]


@pytest.mark.parametrize(
    ("plant", "driven", "identified", "other"),
    [
        ("mujoco", 3, "twin 3", False),
        ("mujoco", 0, "twin 3", True),
        ("mujoco", None, "twin 3", True),
        ("mujoco", 3, None, False),  # nothing is identified
        ("virtual", 0, "twin 0", False),
        ("virtual", 3, "twin 0", True),
        ("real", None, "twin 0", True),
        ("real", None, identified_label(None), True),  # perhaps this one, but nobody can tell
        ("mujoco", None, identified_label(None), True),
    ],
)
def test_reports_say_of_which_other_rig_policies_have_parameters(plant, driven, identified, other):
    values = row(record(TASK, 9.0), plant=plant, twin=driven, identified=identified)
    said = [f"The identified parameters of the rig are of {identified}; other rigs differ from it."]
    assert episodes.notes([values, values]) == said * other


@pytest.fixture
def drawn(monkeypatch):
    """Figures in place of files, by name."""
    figures = {}

    def save(figure, path):
        figures[path.name] = figure
        return path

    monkeypatch.setattr("softrobot_env.rendering.plots.save", save)
    return figures


def test_plots_begin_after_the_approach(drawn, tmp_path):
    plot_task({"hybrid": record(TASK, 14.0)}, TASK, "title", tmp_path, "a")
    assert set(drawn) == {"a_tip.png", "a_lengths.png", "a_path.png"}
    for name in ("a_tip.png", "a_lengths.png"):
        for axis in drawn[name].axes:
            assert all(line.get_xdata()[0] == pytest.approx(10.0) for line in axis.lines)
    error = drawn["a_tip.png"].axes[2].lines[0].get_ydata()
    assert error[-1] == pytest.approx(5.0)  # mm


def test_every_episode_has_a_view_from_above_with_equal_axes(drawn, tmp_path):
    rollouts = {f"policy {k}": record(TASK, 14.0) for k in range(5)}
    plot_task(rollouts, TASK, "title", tmp_path, "a")
    shown = [axis for axis in drawn["a_path.png"].axes if axis.has_data()]
    assert [axis.get_title() for axis in shown] == list(rollouts)
    assert all(axis.get_aspect() == 1.0 for axis in shown)
    assert len({axis.get_xlim() for axis in shown}) == 1
    tip, reference = shown[0].lines
    assert np.hypot(reference.get_xdata(), reference.get_ydata()).min() > 40  # mm, no approach
    assert tip.get_xdata()[0] == pytest.approx(87.5 + 3.0, abs=0.1)


def test_set_points_are_drawn_as_points(drawn, tmp_path):
    task = make_task("reach")
    plot_task({"hybrid": record(task, 14.0)}, task, "title", tmp_path, "a")
    points = drawn["a_path.png"].axes[0].lines[1]
    assert points.get_linestyle() == "None" and len(points.get_xdata()) == 10


def test_an_episode_that_failed_in_the_approach_is_still_named(drawn, tmp_path):
    rollouts = {"good": record(TASK, 14.0), "bad": record(TASK, 9.0, failure="diverged")}
    plot_task(rollouts, replace(TASK, duration=14.0), "title", tmp_path, "a")
    labels = [text.get_text() for text in drawn["a_tip.png"].legends[0].get_texts()]
    assert "bad (failed at 9.00 s)" in labels
