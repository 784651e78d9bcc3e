"""How functions become machine code: compiled, linked and cached, or not at all.

All that touches Numba's inside is here, behind one switch: with `NUMBA_DISABLE_JIT=1` in the
environment everything runs as plain Python, far slower, for debuggers and coverage.
"""

from typing import Any

import numba

from . import notice as notice

#: Whether functions stay as they are.
OFF = bool(numba.config.DISABLE_JIT)

#: Options of a function that compiled code calls, for `njit` and `overload`, and of one that Python
#: or C code calls. Without them Numba does as it always does.
LINKED: dict[str, Any] = {}
CALLED: dict[str, Any] = {}

# Linking builds on the inside of Numba, known of these versions. Others compile as they always do:
# the same machine code, in about twice the time.
if numba.version_info[:2] == (0, 68):
    from . import linking

    LINKED, CALLED = linking.LINKED, linking.CALLED
