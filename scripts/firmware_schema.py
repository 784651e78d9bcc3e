"""The tables of `messages` as a C++ header, so that both sides speak of the same numbers.

`python scripts/firmware_schema.py > firmware/core/schema.h`
"""

import struct
from enum import IntEnum, IntFlag

from softrobot_env.hardware.protocol import messages


def header() -> str:
    """Text of `firmware/core/schema.h`."""
    types = {kind.__name__: number for number, kind in messages.TYPES.items()}
    parts = [_TOP, _constants(), _enumeration("Type", types)]
    parts += [_enumeration(kind.__name__, _members(kind)) for kind in messages.ENUMERATIONS]
    parts += [_flags(kind) for kind in messages.FLAGS]
    return "\n".join([*parts, _layouts(), _BOTTOM])


_TOP = """\
// Written by `python scripts/firmware_schema.py`. Do not edit.
#pragma once

#include <stdint.h>

namespace softrobot {
"""

_BOTTOM = "}  // namespace softrobot"


def _constants() -> str:
    return f"""\
constexpr uint8_t kProtocol = {messages.PROTOCOL};
constexpr uint8_t kMostTendons = {messages.MOST_TENDONS};
constexpr uint8_t kAdcChannels = {messages.ADC_CHANNELS};
constexpr uint8_t kModeLength = {messages.MODE_LENGTH};
constexpr uint8_t kLongestFrame = {messages.LONGEST};  // between its zeros
constexpr uint32_t kSchema = {messages.SCHEMA:#010x};
"""


def _members(kind: type[IntEnum] | type[IntFlag]) -> dict[str, int]:
    """Names as C++ writes them. Not as in Python: `ADC` is a macro on an AVR."""
    return {member.name.title().replace("_", ""): member.value for member in kind}


def _enumeration(name: str, values: dict[str, int]) -> str:
    lines = "".join(f"  k{key} = {value},\n" for key, value in values.items())
    return f"enum class {name} : uint8_t {{\n{lines}}};\n"


def _flags(kind: type[IntFlag]) -> str:
    constants = (f"constexpr uint16_t k{key} = {bit};\n" for key, bit in _members(kind).items())
    name = kind.__name__.lower()
    return f"namespace {name} {{\n{''.join(constants)}}}  // namespace {name}\n"


def _layouts() -> str:
    """C++ function that says the sizes of a message type."""
    cases = "".join(_case(kind) for kind in messages.TYPES.values())
    return f"""\
// Size of a body: `fixed + n * per_tendon` bytes, header included. Where the type tells its
// number of tendons, n stands at index `n_at`, which is 0 for the other types.
struct Layout {{
  uint8_t fixed, per_tendon, n_at;
}};

// False for an unknown type.
inline bool layout_of(uint8_t type, Layout& layout) {{
  switch (type) {{
{cases}    default: return false;
  }}
  return true;
}}
"""


def _case(kind: type[messages.Message]) -> str:
    """Line of one type of message."""
    fixed, per_tendon, n_at = messages.HEADER_SIZE, 0, 0
    for name, code, count in kind.layout:
        size = struct.calcsize(f"<{code}")
        if name == "n":
            n_at = fixed
        if count == "n":
            per_tendon += size
        else:
            fixed += size * count
    layout = f"{{{fixed}, {per_tendon}, {n_at}}}"
    return f"    case {kind.number}: layout = {layout}; break;  // {kind.__name__}\n"


if __name__ == "__main__":
    print(header())
