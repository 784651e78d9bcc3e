"""Nothing that users reach by name is lost without a reason.

tests/ledger.txt has the names (`scripts/ledger.py`); what is gone stands in CHANGELOG.md, below
"What went, and why", in a line that begins with it.
"""

import re
import warnings
from fnmatch import fnmatchcase
from importlib import import_module
from pathlib import Path

import pytest
from support.processes import finished

ROOT = Path(__file__).resolve().parents[1]
REASONS = "What went, and why"


def known() -> list[str]:
    return (ROOT / "tests" / "ledger.txt").read_text().splitlines()


def explained() -> set[str]:
    """Entries of the changelog's lines "* `entry`: reason"; `*` in one stands for anything."""
    text = (ROOT / "CHANGELOG.md").read_text().partition(REASONS)[2]
    return set(re.findall(r"^\* `([^`]+)`: \w", re.split(r"^## ", text, flags=re.M)[0], re.M))


def is_explained(entry: str, reasons: set[str]) -> bool:
    return any(fnmatchcase(entry, one) for one in reasons)


def imports(entry: str) -> bool:
    """Whether a line "import module:name" works, perhaps with a warning."""
    module, _, name = entry.removeprefix("import ").partition(":")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            found = import_module(module)
            if name and not hasattr(found, name):
                import_module(f"{module}.{name}")
    except ImportError:
        return False
    return True


def test_nothing_is_lost_without_a_reason():
    # On its own: other tests register entries.
    result = finished("scripts/ledger.py", cwd=ROOT, check=True)
    there, reasons = set(result.stdout.splitlines()), explained()
    assert len(there) > 500
    lost = [
        entry
        for entry in known()
        if entry not in there and not (entry.startswith("import ") and imports(entry))
    ]
    assert not [entry for entry in lost if not is_explained(entry, reasons)]


@pytest.mark.parametrize("entry", ["import softrobot_env.nowhere", "import softrobot_env:nothing"])
def test_an_import_that_is_gone_is_seen(entry):
    assert not imports(entry)


def test_a_reason_may_be_for_several():
    assert is_explained("policy a_b", {"policy a*"}) and not is_explained("policy a", {"policy ab"})
