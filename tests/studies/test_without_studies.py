"""What `softrobot benchmark` says where only the wheel is installed."""

from softrobot_env.cli import main
from softrobot_env.core import registry
from softrobot_env.core.studies import BENCHMARKS


def test_the_wheel_alone_says_where_studies_are(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(registry, "_entry_points", lambda *_: [])
    monkeypatch.setattr(registry, "_called", set())
    monkeypatch.setattr(BENCHMARKS, "_own", {})
    assert main(["benchmark", "controllers", "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "'controllers'" in line and "scripts/studies of its repository" in line
