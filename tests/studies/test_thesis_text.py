"""Numbers in the thesis' text against those of the audit (docs/thesis_audit.md)."""

import pytest

from studies.thesis_text import share_rows


def test_the_dynamic_share_is_that_of_the_audit():
    effective, tensions = share_rows()
    assert effective.value == pytest.approx(0.079, abs=5e-4)
    # Pretension is in the whole and not in the part.
    assert 0.5 * effective.value < tensions.value < effective.value
