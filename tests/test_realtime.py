"""Tests that depend on the clock: what becomes of them on busy and on quiet machines."""

from pathlib import Path
from xml.etree import ElementTree

from support.processes import finished

TESTS = Path(__file__).parent

INNER = """
import time, pytest

@pytest.mark.realtime(late=1e-9)
def test_that_asks_for_too_much():
    time.sleep(0.1)
    assert False

@pytest.mark.realtime(late=1e3)
def test_whose_machine_was_good_enough():
    time.sleep(0.1)
    assert False

@pytest.mark.realtime(late=1e-9)
def test_that_passes():
    time.sleep(0.1)

def test_without_a_clock():
    assert False
"""


CONFTEST = f"""
import sys
from importlib.util import module_from_spec, spec_from_file_location

sys.path.insert(0, {str(TESTS)!r})
spec = spec_from_file_location("outer", {str(TESTS / "conftest.py")!r})
outer = module_from_spec(spec)
spec.loader.exec_module(outer)
pytest_runtest_call = outer.pytest_runtest_call

def pytest_configure(config):
    config.addinivalue_line("markers", "realtime(late): a clock")
"""


def test_failures_are_skipped_only_where_the_machine_did_not_give_what_they_need(tmp_path):
    (tmp_path / "test_inner.py").write_text(INNER)
    (tmp_path / "conftest.py").write_text(CONFTEST)
    found = tmp_path / "found.xml"
    command = ("-m", "pytest", "--rootdir", tmp_path, f"--junitxml={found}", tmp_path)
    done = finished(*command, cwd=tmp_path)
    assert found.exists(), done.stdout + done.stderr
    outcomes = {
        case.get("name"): [child.tag for child in case]
        for case in ElementTree.parse(found).iter("testcase")
    }
    assert outcomes == {
        "test_that_asks_for_too_much": ["skipped"],
        "test_whose_machine_was_good_enough": ["failure"],
        "test_that_passes": [],
        "test_without_a_clock": ["failure"],
    }
    assert "needs a machine that wakes processes within 1e-06 ms" in found.read_text()
