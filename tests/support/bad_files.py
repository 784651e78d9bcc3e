"""Files that were edited badly."""

import pytest


def assert_refused(read, path, old, new, said):
    """A file of which one text is replaced is refused in one line with its place."""
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises(ValueError, match=said) as caught:
        read(path)
    assert str(path.with_suffix("")) in str(caught.value) and "\n" not in str(caught.value)
