"""No file that is damaged, incomplete or not finite gets into a policy."""

import json
import zipfile
from functools import partial

import numpy as np
import pytest

from softrobot_env.control.learned.neural import NeuralPolicy
from softrobot_env.control.registry import make_policy
from softrobot_env.core.artifacts import Arrays, read_arrays, read_facts
from softrobot_env.core.files import models_dir
from softrobot_env.learned.network import Network
from softrobot_env.robots import ARM, RIG
from softrobot_env.thesis.rig.parameters import IdentifiedParameters

#: Options of policies that read a shipped file, and their control periods [s].
FILES = {
    "lqi": ("gains", 1e-3),
    "lq_preview": ("gains", 1e-3),
    "qs_nn": ("weights", 0.01),
    "ppo": ("weights", 0.01),
}


def load(name, path, arm=ARM):
    """What reads a shipped file."""
    if name == "rig_nn":
        return IdentifiedParameters.load(RIG, path)
    option, period = FILES[name]
    return make_policy(name, arm, period, **{option: path})


def shipped(name):
    return dict(read_arrays(models_dir() / f"{name}.npz"))


def assert_refused(name, path, said, **changes):
    """A shipped file with other arrays, or without those that are None, is refused."""
    arrays = shipped(name) | changes
    np.savez(path, **{key: array for key, array in arrays.items() if array is not None})
    with pytest.raises(ValueError, match=said):
        load(name, path)


def arrays_of(name):
    found, but = shipped(name), ("workspace", "tendon_stiffness")
    return [key for key in found if found[key].dtype.kind == "f" and not key.endswith(but)]


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["qs_nn", "ppo", "rig_nn", "lqi", "lq_preview"])
def test_networks_and_gains_that_are_not_finite_are_refused_by_file_and_array(
    name, value, tmp_path
):
    path = tmp_path / "bad.npz"
    for key in ["gains"] if "gains" in FILES.get(name, ()) else arrays_of(name):
        array = shipped(name)[key].copy()
        array.flat[-1] = value
        said = f"bad.npz: 1 of .* array '{key}' are not finite"
        assert_refused(name, path, said, **{key: array})


def test_networks_with_other_ends_are_refused(tmp_path):
    """Compiled code would read beyond the arrays."""
    two = {"bias_1": np.zeros(2), "weight_1": np.zeros((2, 30))}
    two |= {"output_low": np.zeros(2), "output_high": np.ones(2)}
    said = r"bad\.npz must have 7 inputs and 3 outputs"
    assert_refused("qs_nn", tmp_path / "bad.npz", said, **two)
    network, _ = Network.load(models_dir() / "qs_nn.npz")
    with pytest.raises(ValueError, match="must have 29 inputs and 3 outputs, it has 7 and 3"):
        NeuralPolicy(ARM, 0.01, network)


def test_a_stiffness_of_no_robot_is_refused(tmp_path):
    said = r"bad\.npz: .* stiffness must be finite and positive"
    assert_refused("rig_nn", tmp_path / "bad.npz", said, about_stiffness=np.array(-1.0))


@pytest.mark.parametrize("name", FILES)
def test_files_of_other_robots_and_missing_ones_tell_what_makes_them(name, tmp_path):
    command = f"`softrobot train {name} --robot"
    with pytest.raises(ValueError, match=rf"{command} arm_changed\.toml"):
        load(name, models_dir() / f"{name}.npz", ARM.vary(youngs_modulus=0.5))
    with pytest.raises(FileNotFoundError, match=f"{command} arm"):
        load(name, tmp_path / "none.npz")


def single(path):
    with path.open("wb") as file:
        np.save(file, np.zeros(3))


def zipped(path):
    """A zip file without arrays."""
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("data.pkl", b"anything")


@pytest.mark.parametrize(
    "write",
    [
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(b"text"),
        lambda path: path.write_bytes(b"PK\x03\x04"),
        lambda path: np.savez(path, a=np.array([{}], dtype=object)),
        single,
        zipped,
    ],
    ids=["empty", "text", "cut", "objects, which could run code", "a single array", "zip"],
)
def test_other_files_are_refused(write, tmp_path):
    path = tmp_path / "bad.npz"
    with pytest.raises(FileNotFoundError):
        read_arrays(path)
    write(path)
    readers = [partial(load, name) for name in ("lqi", "qs_nn", "ppo", "rig_nn")]
    for read in (read_arrays, Network.load, *readers):
        with pytest.raises(ValueError, match=r"bad\.npz is no npz file of arrays, or damaged"):
            read(path)


def test_infinity_is_allowed_where_it_has_a_meaning():
    arrays = Arrays("f", {"a": np.array([np.inf]), "b": np.array([np.nan]), "t": np.array("x")})
    arrays.check_finite(infinite=("a",), unmeasured=("b",))
    with pytest.raises(ValueError, match="'b'"):
        arrays.check_finite(infinite=("a", "b"))
    with pytest.raises(ValueError, match="'a'"):
        arrays.check_finite(unmeasured=("b",))


def test_facts_are_finite_json(tmp_path):
    path = tmp_path / "facts.json"
    path.write_text(json.dumps({"steps": [1, 2.5]}), encoding="utf-8")
    assert read_facts(path) == {"steps": [1, 2.5]}
    for text in ('{"a": NaN}', "[Infinity]", '{"a": 1', "\x00", "[" * 20000):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match=r"facts\.json"):
            read_facts(path)
