"""LLVM code that comes with the package gives what its sources give, or is not used."""

import json
import os
import platform
import sys
import zlib
from importlib.util import module_from_spec, spec_from_file_location

import numba
import numpy as np
import pytest
from support.processes import finished

from softrobot_env.compile import LINKED, OFF

if LINKED and not OFF:
    from softrobot_env.compile.native import ADDRESS, INT, types
    from softrobot_env.compile.prepared import PreparedFunction

pytestmark = pytest.mark.skipif(OFF or not LINKED, reason="nothing is prepared")

SIGNATURE = (ADDRESS, ADDRESS, INT, ADDRESS), types.void

SOURCE = """
from softrobot_env.compile.native import array_at, jit
from constant import FACTOR
import numpy as np

@jit
def times(values, factor):
    for i in range(values.size):
        values[i] *= factor

def scale(place, unused, size, other):
    times(array_at(np.uint64(place), (size,), np.float64), FACTOR)
"""


@pytest.fixture
def make(tmp_path, monkeypatch):
    """Makes `scale` of sources as they are, as a new process would."""
    monkeypatch.syspath_prepend(tmp_path)
    file, constant = tmp_path / "scaling.py", tmp_path / "elsewhere" / "constant.py"
    constant.parent.mkdir()
    monkeypatch.syspath_prepend(constant.parent)
    file.write_text(SOURCE)
    constant.write_text("FACTOR = 3.0\n")

    def made():
        monkeypatch.delitem(sys.modules, "constant", raising=False)
        spec = spec_from_file_location("scaling", file)
        module = module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "scaling", module)
        spec.loader.exec_module(module)
        return PreparedFunction(module.scale, SIGNATURE, (file, constant))

    made.file, made.constant = file, constant
    return made


def factor(function):
    """By how much it multiplies, once compiled, without what is in the cache."""
    function._cache._cache_file.flush()
    function.compile()
    values = np.ones(3)
    function.ctypes(values.ctypes.data, 0, 3, 0)
    return values.tolist()


def test_prepared_code_is_used_and_does_the_same(make, monkeypatch):
    function = make()
    assert function.prepared() is None and factor(function) == [3.0] * 3
    function.place.write_bytes(function.prepare())
    made = make()
    monkeypatch.setattr(made, "compiled", lambda: pytest.fail("compiled"))
    assert factor(made) == [3.0] * 3
    again = make()  # from the cache
    monkeypatch.setattr(again, "prepared", lambda: pytest.fail("prepared"))
    again.compile()
    values = np.full(2, 2.0)
    again.ctypes(values.ctypes.data, 0, 2, 0)
    assert values.tolist() == [6.0, 6.0]


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "no code", "another key"])
def test_damaged_code_is_not_used(make, damage):
    function = make()
    function.place.write_bytes(function.prepare())
    whole = function.place.read_bytes()
    content = zlib.decompress(whole)
    other = bytes([content[0] ^ 1]) + content[1:]
    function.place.write_bytes(
        {
            "cut": whole[: len(whole) // 2],
            "flipped": whole[:-20] + bytes([whole[-20] ^ 1]) + whole[-19:],
            "empty": b"",
            "no code": zlib.compress(content[:64] + b"scale\nno code"),
            "another key": zlib.compress(other),
        }[damage]
    )
    made = make()
    assert made.prepared() is None
    assert factor(made) == [3.0] * 3


def test_code_of_other_sources_numba_or_switches_is_not_used(make, monkeypatch):
    function = make()
    function.place.write_bytes(function.prepare())
    make.file.write_text(SOURCE + "# what says nothing changes nothing\n")
    assert make().prepared() is not None
    for name, value in (("__version__", "0.68.999"), ("config.BOUNDSCHECK", 1)):
        with monkeypatch.context() as changed:
            changed.setattr(f"numba.{name}", value)
            assert make().prepared() is None, name
    # Of another size, as Python keeps bytecode by size and second.
    make.constant.write_text("FACTOR = 8.0 / 2\n")
    made = make()
    assert made.prepared() is None and factor(made) == [4.0] * 3


@pytest.mark.skipif(
    (sys.platform, platform.machine()) != ("linux", "x86_64"), reason="of Linux on x86-64 alone"
)
def test_what_comes_with_the_package_is_of_its_sources():
    """After an edit of the integrator: `make prepared`."""
    import prepared

    assert numba.__version__ and prepared.main(["--check"]) == 0


_MOTIONS = """
import json, sys
import gymnasium
import softrobot_env
from softrobot_env.compile.notice import NOTICE
from softrobot_env.compile.prepared import PreparedFunction

if sys.argv[1] == "compiled":
    PreparedFunction.prepared = lambda self: None
found = []
for name in ("ArmSwing", "RigTriangle"):
    env = gymnasium.make(f"SoftRobot/{name}-v0")
    env.action_space.seed(0)
    env.reset(seed=0)
    for _ in range(100):
        observation = env.step(env.action_space.sample())[0]
    found.append({key: value.tolist() for key, value in observation.items()})
print(json.dumps([NOTICE.count, found]))
"""


@pytest.mark.slow
def test_motions_are_the_same_to_the_bit(tmp_path):
    script, found = tmp_path / "motions.py", {}
    script.write_text(_MOTIONS)
    for how in ("prepared", "compiled"):
        places = dict.fromkeys(("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"), str(tmp_path / how))
        own = os.environ | places | {"PYTHONPATH": os.pathsep.join(sys.path)}
        found[how] = json.loads(finished(script, how, env=own, check=True).stdout)
    assert found["prepared"][0] == 0 and found["compiled"][0] > 50  # functions compiled
    assert found["prepared"][1] == found["compiled"][1]
