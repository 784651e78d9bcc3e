"""What takes long says so, and what is quick does not."""

import re
import time

import pytest

from softrobot_env.core import under_way


@pytest.fixture(autouse=True)
def hurried(monkeypatch):
    monkeypatch.setattr(under_way, "SPEAKS", True)
    monkeypatch.setattr(under_way, "GAP", 0.1)


def test_the_innermost_work_is_said_until_it_ends(capsys):
    with under_way.under_way(lambda: "outer"):
        time.sleep(0.25)
        with under_way.under_way(lambda: "inner"):
            time.sleep(0.25)
        time.sleep(0.25)
    time.sleep(0.25)
    lines = [line.partition(",")[0] for line in capsys.readouterr().err.splitlines()]
    order = [line for k, line in enumerate(lines) if k == 0 or line != lines[k - 1]]
    assert order == ["outer", "inner", "outer"]


def test_quick_work_says_nothing_unless_it_is_told(capsys):
    under_way.tell("nothing is under way")
    with under_way.under_way(lambda: "work"):
        under_way.tell("part one")
    assert re.fullmatch(r"part one, 0 s\n", capsys.readouterr().err)


def test_what_shows_itself_is_not_said(capsys):
    with under_way.under_way(lambda: "outer"), under_way.under_way(None):
        under_way.tell("part one")
        time.sleep(0.25)
    with under_way.under_way(lambda: ""):
        time.sleep(0.25)
    assert capsys.readouterr().err == ""


def test_long_work_is_said_less_often(capsys, monkeypatch):
    monkeypatch.setattr(under_way, "GAP", 0.01)
    monkeypatch.setattr(under_way, "SHARE", 0.5)
    with under_way.under_way(lambda: "work"):
        time.sleep(0.7)
    assert 3 <= len(capsys.readouterr().err.splitlines()) <= 8  # at 10, 20, 40, ... 640 ms


def test_nothing_is_said_where_nobody_wants_it(capsys, monkeypatch):
    monkeypatch.setattr(under_way, "SPEAKS", False)
    with under_way.under_way(lambda: "work"):
        under_way.tell("part one")
        time.sleep(0.25)
    assert capsys.readouterr().err == ""
