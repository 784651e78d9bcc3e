"""The command line in tests."""

import json

from softrobot_env.cli import main


def called(*words):
    """Exit status of `softrobot` with words, which may be several in a text."""
    return main(" ".join(map(str, words)).split())


def rows_in(folder):
    """Rows of the report in a folder."""
    return json.loads((folder / "report.json").read_text())["rows"]


def evaluated(out, *words):
    """Rows of `softrobot evaluate` with words, which goes well and writes to a folder."""
    assert called("evaluate", *words, "--out", out, "--overwrite") == 0
    return rows_in(out)
