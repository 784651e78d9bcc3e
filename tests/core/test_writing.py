"""Files are written whole or not at all."""

import os
import re
from pathlib import Path

import pytest

from softrobot_env.core.files import atomic_write, write_text

PACKAGE = Path(__file__).resolve().parents[2] / "softrobot_env"


def test_a_file_appears_when_it_is_whole_and_folders_are_made(tmp_path):
    path = tmp_path / "new" / "a.txt"
    with atomic_write(path) as aside:
        aside.write_text("half")
        assert not path.exists() and aside.suffix == ".txt"
    assert [p.name for p in path.parent.iterdir()] == ["a.txt"] and path.read_text() == "half"


def test_a_failure_leaves_what_was_there(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "before")
    with pytest.raises(KeyboardInterrupt), atomic_write(path) as aside:
        aside.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "before" and len(list(tmp_path.iterdir())) == 1


def test_what_is_no_file_is_not_replaced_and_links_stay_links(tmp_path):
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    with pytest.raises(FileExistsError, match=r"no file.*pipe"):
        write_text(pipe, "")
    link.symlink_to(tmp_path / "a.txt")
    write_text(link, "through")
    assert link.is_symlink() and (tmp_path / "a.txt").read_text() == "through"


def test_an_error_names_the_file_that_was_asked_for(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match=r"file/a\.txt'$"):
        write_text(tmp_path / "file" / "a.txt", "")


def test_nothing_else_writes_files():
    """But the log of a line, which grows while a robot runs, and what `atomic_write` is round."""
    writes = re.compile(r'\.write_text\(|\.write_bytes\(|savez\w*\(|"wb"|"w"|"xb"')
    found = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if writes.search(path.read_text())
    }
    assert found == {
        "core/artifacts.py",
        "core/files.py",
        "hardware/transport.py",
        "recordings/columns.py",
        "training/several/runs.py",
    }
