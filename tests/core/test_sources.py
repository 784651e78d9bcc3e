"""What a run depends on: named, digested by meaning, also what workers and earlier runs loaded."""

import os
import sys

import pytest

from softrobot_env.core import sources
from softrobot_env.core.files import models_dir, readable
from softrobot_env.core.registry import PACKAGES, load
from softrobot_env.core.runs import KEPT, kept_rows, run_cases

LAW = '''"""A law."""

GAIN = 2.0


def act(x, name="x's"):
    """Act."""
    return {name: [GAIN * x, None, -1e-3j, f"{x:.3f} {name!r}"]}
'''

CASES = """
from dataclasses import dataclass
from softrobot_env.core.runs import Row

@dataclass(frozen=True)
class Double(Row):
    twice: int

def measure(case):
    from others.late import double
    return Double(double(case))
"""


def write(path, text):
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    os.utime(path, (1e9, 1e9))  # before this process began


@pytest.fixture
def others(tmp_path, monkeypatch):
    """The folder of a package of somebody else."""
    folder = tmp_path / "others"
    for name, text in {"__init__": "", "law": LAW, "cases": CASES}.items():
        write(folder / f"{name}.py", text)
    write(
        folder / "late.py",
        "def double(x):\n    return sum(k * k for k in range(10**6)) * 0 + 2 * x",
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sources, "_added", set())
    monkeypatch.setattr(sources, "_seconds_added", 0.0)
    load("others.law:act")
    yield folder
    PACKAGES.discard("others")
    sources._bases.cache_clear()
    for name in [name for name in sys.modules if name.startswith("others")]:
        del sys.modules[name]


@pytest.mark.parametrize(
    ("old", "new", "count"),
    [
        ('"""A law."""', "# A law that is told otherwise.", 0),
        ('    """Act."""\n', "", 0),
        ("[GAIN * x, None", "[\n        (GAIN * x),\n        None", 0),
        ("GAIN = 2.0", "GAIN = 2.0\n__version__ = '7'", 0),
        ("GAIN = 2.0", "GAIN = 2", 1),
        ("GAIN * x", "x * GAIN", 1),
        ("None, -1e-3j", "-1e-3j, None", 1),
        (":.3f", ":.4f", 1),
        ("!r", "!s", 1),
        ("(x, name=", "(x, *, name=", 1),
    ],
)
def test_a_change_of_meaning_is_named(old, new, count, others):
    record = sources.recorded()
    assert {"others", "others.law"} <= record.keys() and sources.changed(record) == []
    assert old in LAW
    write(others / "law.py", LAW.replace(old, new))
    sources._digest_since.cache_clear()
    assert sources.changed(record) == ["others.law"] * count


def test_what_is_gone_or_was_written_meanwhile_is_named(others):
    (others / "law.py").write_text(LAW)
    record = sources.recorded()
    assert sources.changed(record) == ["others.law"]
    (others / "__init__.py").unlink()
    assert sources.changed(record) == ["others", "others.law"]


def test_files_that_were_read_count_and_what_shows_rows_does_not():
    model = sorted(models_dir().glob("*.npz"))[0]
    readable(model)
    found = sources.used()
    assert f"models/{model.name}" in found and "softrobot_env.core.runs" in found
    assert "softrobot_env.core.sources" not in found
    assert all(map(sources._place, sources._SHOWING))


def test_what_workers_loaded_counts_also_when_a_run_is_gone_on_with(others, tmp_path, monkeypatch):
    measure, kind = load("others.cases:measure"), load("others.cases:Double")

    def rows():
        with kept_rows(tmp_path / KEPT, "a study") as kept:
            run_cases([1, 2], measure, kinds=(kind,), kept=kept, processes=1)
            assert "others.late" in sources.recorded() and "others.late" not in sys.modules
            raise InterruptedError

    with pytest.raises(InterruptedError):
        rows()
    monkeypatch.setattr(sources, "_added", set())
    assert "others.late" not in sources.used()
    before = sources.cpu_seconds()
    monkeypatch.setattr("softrobot_env.core.runs.worker_processes", None)  # nothing is measured
    with pytest.raises(InterruptedError):
        rows()
    assert sources.cpu_seconds() > before + 0.05
