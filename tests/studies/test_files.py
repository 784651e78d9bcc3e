"""The study of random robot files: a few files, and a chain that claims too much."""

from softrobot_env.scene import resolution
from softrobot_env.scene.resolution import Discretization
from studies.files import measure
from studies.files_drawn import draw_file


def test_no_file_is_silently_wrong():
    rows = [row for index in range(6, 9) for row in measure((11, index))]
    assert {row.verdict for row in rows} <= {"accurate", "warned", "refused"}
    judged = [row for row in rows if row.verdict == "accurate" and row.judged]
    assert judged and all(row.error_share < row.estimate_share < 1e-3 for row in judged)


def test_a_chain_that_claims_too_much_is_found(monkeypatch):
    perfect = 1, Discretization(0.0, 0.0, 1, 0)
    monkeypatch.setattr(resolution, "_search", lambda config, adaptive=False: perfect)
    (row,) = measure((1, 30))
    assert (row.pieces, row.verdict) == (row.own, "silent")
    assert row.error_share > 1e-3


def test_a_file_is_the_same_whatever_else_is_drawn():
    draw_file(3, 0)
    assert draw_file(3, 1) == draw_file(3, 1) != draw_file(4, 1)
    assert "pieces" not in draw_file(3, 1)
