"""The table of messages that both sides must share."""

import pytest

from softrobot_env.hardware.protocol import messages as m


@pytest.mark.parametrize("kind", [*m.ENUMERATIONS, *m.FLAGS])
def test_every_number_that_stands_for_something_is_in_the_schema(kind):
    (line,) = [x for x in m.schema_text().splitlines() if x.startswith(f"{kind.__name__} ")]
    assert line.split()[1:] == [f"{code.name}={code.value}" for code in kind]
