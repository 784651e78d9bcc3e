"""What is compared with other packages, also where these are not installed."""

import pytest

from studies import peers
from studies.lab import Lab
from studies.peers import OURS, Gradient, Row


def motion(package, model, error, seconds):
    reported = {"e_mean": error, "e_max": error, "core_seconds": seconds, "text": "limit"}
    return Row("motion", package, "1", model, 3, "any", None, 1e-2, **reported)


def test_a_ratio_is_to_the_fastest_of_ours_that_errs_no_more():
    rows = [
        motion(OURS, "mujoco_chain/gauss2", 2e-3, 0.001),
        motion(OURS, "mujoco_chain/gauss2", 9e-4, 0.002),
        motion(OURS, "mujoco_chain/gauss2", 1e-4, 0.010),
        motion("soromox", "PlanarPCS", 1e-3, 0.020),
        motion("soromox", "PlanarPCS", 5e-3, 0.030),  # a faster one of it errs less
    ]
    (ratio,) = peers.ratios(rows)
    assert ratio.value == pytest.approx(10) and ratio.model == "mujoco_chain"
    assert peers.with_ratios(rows) == [*rows, ratio]


def test_gradients_are_compared_by_their_own_errors():
    def gradient(package, error, seconds):
        about = {"model": "any", "n": 6, "integrator": "any", "tolerance": None}
        cost = {"core_seconds": seconds, "compiled": 1.0, "over_motion": 3.0}
        return Gradient("gradient", package, "1", e_gradient=error, **about, **cost)

    ours = [gradient(OURS, 0.2, 0.01), gradient(OURS, 0.05, 0.02)]
    theirs = [gradient("soromox", 0.08, 2.0), gradient("soromox", 0.01, 3.0)]
    found = peers.compared([*ours, *theirs])
    assert found[:2] == ours and found[3] == theirs[1]
    assert found[2].times == pytest.approx(100)


def test_absent_peers_are_said(monkeypatch):
    monkeypatch.setattr(peers, "find_spec", lambda name: None)
    monkeypatch.setattr(peers, "truth", lambda quick: None)
    monkeypatch.setattr(peers, "our_rows", lambda limit, quick: [])
    monkeypatch.setattr(peers, "true_gradient", lambda limit, quick: None)
    monkeypatch.setattr(peers, "our_gradients", lambda limit, true, quick: [])
    monkeypatch.setattr(peers, "our_row", lambda quick: Row("environment", OURS))
    rows = peers.stages(Lab(quick=True, processes=0))
    notes = [row.text for row in rows if row.kind == "note"]
    assert len(notes) == 2 and all("pip install" in text for text in notes)


def test_our_chain_moves_like_the_limit():
    """The chain made of another robot than the arm: what SoRoMoX is compared with."""
    limit = peers.truth(quick=True)
    rows = list(peers.our_rows(limit, quick=True))
    assert limit.uncertainty < 2e-5
    assert min(r.e_mean for r in rows if r.model.startswith("pcc")) < 5e-4
    assert min(r.e_mean for r in rows if r.model.startswith("mujoco_chain")) < 5e-4


def test_our_gradient_nears_that_of_the_limit():
    """Second order in the pieces: a quarter of the error with twice as many."""
    limit = peers.truth(quick=True)
    coarse, fine = peers.our_gradients(limit, peers.true_gradient(limit, quick=True), quick=True)
    assert fine.e_gradient < 0.35 * coarse.e_gradient < 0.1
    assert fine.over_motion < 6
