"""Robot files of every kind: each has a task, a policy that runs on it, and a picture."""

import pytest
from support.commands import called, evaluated

from softrobot_env.robots.file import read_robot
from studies.files_drawn import draw_file

HEAD = """
name = "{name}"
gravity_m_s2 = [0, 0, -9.81]
base = {{ position_m = [0, 0, 0.6], direction = {direction} }}
{head}
[[section]]
length_m = 0.30
outer_radius_m = {radius}
youngs_modulus_Pa = 5.0e5
poisson_ratio = 0.45
density_kg_m3 = 1070
damping_time_s = 0.03

[[tendon]]
name = {tendons}
ends_at_section = 1
radius_m = {distance}
tension_limit_N = 15
{more}
"""
USUAL = {
    "direction": [0, 0, -1],
    "head": "",
    "radius": 0.02,
    "tendons": ["a", "b", "c"],
    "distance": 0.015,
    "more": "",
}
BY_LENGTH = 'drive = "length"\nstiffness_N_m = 3000'
CARRIED = (
    "[head]\nmass_kg = 0.02\ncentre_m = 0.02\noutput_m = 0.04\ninertia_kg_m2 = [2e-6, 2e-6, 2e-6]"
)

#: What a file says otherwise than `USUAL`.
KINDS = {
    "one_by_length": {"tendons": ["a"], "more": BY_LENGTH},
    "pair_by_length": {"tendons": ["a", "b"], "more": BY_LENGTH},
    "helix": {"more": "helix_turns = 0.6"},
    "taper": {"radius": [0.025, 0.008], "distance": 0.006},
    "eight": {"tendons": [*"abcdefgh"]},
    "head": {"head": CARRIED},
    "sideways": {"direction": [1, 0, 0]},
}

QUICK = "pair_by_length", "head"

#: Files of a quick run, and what all are drawn from.
FEW = (13,)
SEED = 7

#: Of the files of a long run, chains that are too light for MuJoCo.
REFUSED = (15,)


def serves(path, capsys):
    """Whether a file is good; if so it has a task, an episode and a picture."""
    if called("robot-file check", path):  # chains too light for MuJoCo
        capsys.readouterr()
        assert called("list --robot", path) == 2
        assert not capsys.readouterr().out
        return False
    capsys.readouterr()
    assert called("list tasks --robot", path) == 0
    assert "reach options seed" in " ".join(capsys.readouterr().out.split())
    words = "--tasks reach --policies static --duration 0.1 --no-plots --overwrite"
    (row,) = evaluated(path.parent / "out", "--robot", path, words)
    assert row["failure"] is None and row["e_final"] < 2 * read_robot(path).reach
    out = path.with_suffix(".gif")
    size = "--duration 0.05 --fps 20 --size 64 48 --out"
    assert called("render --task reach --policy static --robot", path, size, out) == 0
    return out.stat().st_size > 500


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("kind", QUICK)
def test_a_robot_of_a_kind_is_served(kind, tmp_path, capsys):
    path = tmp_path / f"{kind}.toml"
    path.write_text(HEAD.format(name=kind, **USUAL | KINDS[kind]).replace("'", '"'))
    assert serves(path, capsys)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("kind", sorted(KINDS.keys() - set(QUICK)))
def test_every_kind_of_robot_is_served(kind, tmp_path, capsys):
    test_a_robot_of_a_kind_is_served(kind, tmp_path, capsys)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("index", FEW)
def test_a_random_file_is_served(index, tmp_path, capsys):
    path = tmp_path / "drawn.toml"
    path.write_text(draw_file(SEED, index))
    assert serves(path, capsys)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("index", range(3, 100, 12))
def test_more_random_files_are_served(index, tmp_path, capsys):
    path = tmp_path / "drawn.toml"
    path.write_text(draw_file(SEED, index))
    assert serves(path, capsys) or index in REFUSED
