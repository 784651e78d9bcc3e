"""A study of somebody else, in one file, from the command line; what the wheel says without any."""

import json
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from softrobot_env.cli import main
from softrobot_env.core import registry
from softrobot_env.core.studies import BENCHMARKS

FILE = Path(__file__).resolve().parents[1] / "outside" / "study.py"


@pytest.fixture
def registered():
    spec = spec_from_file_location("outside_study", FILE)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    module.register()
    yield
    del BENCHMARKS.registered()["lengths"]


def test_one_file_adds_a_study(registered, tmp_path):
    pytest.importorskip("matplotlib")
    assert len(FILE.read_text().splitlines()) <= 60
    words = ["benchmark", "lengths", "--out", str(tmp_path)]
    assert main(words) == 0
    rows = json.loads((tmp_path / "lengths" / "report.json").read_text())["rows"]
    assert [row["share"] for row in rows] == [0.5, 1.0] * 2
    picture = tmp_path / "lengths" / "lengths.png"
    before = picture.read_bytes()
    assert main([*words, "--redraw"]) == 0 and picture.read_bytes() == before
    assert main([*words, "--quick", "--overwrite"]) == 0
    assert len(json.loads((tmp_path / "lengths" / "report.json").read_text())["rows"]) == 2


def test_the_wheel_alone_says_where_studies_are(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(registry, "_entry_points", list)
    monkeypatch.setattr(registry, "_called", set())
    monkeypatch.setattr(BENCHMARKS, "_own", {})
    assert main(["benchmark", "controllers", "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "'controllers'" in line and "scripts/studies of its repository" in line
