"""Pieces that taper, and how many pieces a chain needs."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from softrobot_env.evaluation.models.runs import beam_of
from softrobot_env.robots import RobotParams, Section, Tendon, find_robot
from softrobot_env.robots.file import read_robot, write_robot
from softrobot_env.robots.loads import Load
from softrobot_env.robots.parameters import Drive
from softrobot_env.robots.sections import Backbone
from softrobot_env.scene import resolution
from softrobot_env.scene.assembly import Assembly, Member, build_assembly
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import RULES, place_between
from softrobot_env.scene.registry import scene_of
from softrobot_env.scene.resolution import ResolutionWarning
from studies.truths.tendon_rod import hanging_rod, tendon_rod

LENGTH, MODULUS = 0.3, 2e6


def cone(*radii: float, pieces: int = 1, inner: float = 0.0) -> RobotParams:
    """A straight rod of such radii [m] at base and tip, without weight."""
    section = Section(LENGTH, radii, MODULUS, 1050.0, 0.02, pieces, inner, 0.4)
    return RobotParams("cone", sections=(section,))


@pytest.mark.parametrize("radii", [(0.012, 0.002), (0.004, 0.01)])
@pytest.mark.parametrize(("rule", "pieces"), [("gauss2", 1), ("gauss2", 3), ("gauss3", 1)])
def test_tip_of_a_cone_under_a_small_force_is_exact(radii, rule, pieces):
    """Castigliano: F times the integral of (L - s)^2 / EI."""
    robot, force = cone(*radii, pieces=pieces), 1e-7
    load = Load("push", LENGTH, (force, 0.0, 0.0))
    scene = build_scene(SceneConfig(robot, rule=rule, loads=(load,)))

    def give(s: float) -> float:
        return (LENGTH - s) ** 2 / robot.backbone.bending(np.array([s]))[0]

    exact = force * quad(give, 0, LENGTH, epsabs=0, epsrel=1e-10)[0]
    tip = scene.tip(scene.equilibrium(np.ones(1)))
    assert tip[0] == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize("rule", list(RULES))
@pytest.mark.parametrize("inner", [0.0, 0.8])
@pytest.mark.parametrize("ratio", [0.02, 0.3, 0.999, 1.1, 4.0, 50.0])
def test_hinges_of_any_taper_lie_in_their_parts(rule, inner, ratio):
    radii = (0.01, 0.01 * ratio)
    hollow = tuple(inner * r for r in radii)
    section = Section(LENGTH, radii, MODULUS, 1050.0, 0.02, 2, hollow)
    edges = np.array([0.0, 0.5, 1.0]) * LENGTH
    layout = place_between(edges, rule, Backbone([section]))
    parts = np.append(0.0, np.cumsum(layout.weights))
    assert parts[-1] == pytest.approx(LENGTH)
    assert layout.piece.tolist() == sorted([0, 1] * len(RULES[rule]))
    assert np.all(parts[:-1] < layout.stations) and np.all(layout.stations < parts[1:])


@pytest.mark.parametrize("rule", list(RULES))
def test_a_cone_of_nearly_no_taper_is_a_uniform_rod(rule):
    near, plain = (SceneConfig(cone(0.01, r), pieces=3, rule=rule) for r in (0.01 + 1e-9, 0.01))
    for name in ("stations", "weights"):
        got, wanted = (getattr(config.layout, name) for config in (near, plain))
        np.testing.assert_allclose(got, wanted, rtol=1e-5)


# ---------------------------------------------------------------- how many pieces


def read(
    folder: Path, radii: list[float], modulus: float, tendon: str, more: str = ""
) -> RobotParams:
    """The robot of a file that says no pieces unless `more` of its section does."""
    path = folder / "robot.toml"
    path.write_text(
        f"""
name = "drawn"
{"" if "gravity" not in more else more}
[[section]]
length_m = {LENGTH}
outer_radius_m = {radii}
youngs_modulus_Pa = {modulus}
poisson_ratio = 0.4
density_kg_m3 = 1050
damping_time_s = 0.02
{"" if "gravity" in more else more}
[[tendon]]
name = "pull"
end_m = {LENGTH}
tension_limit_N = 8
{tendon}
"""
    )
    return read_robot(path)


#: Radii [m], Young's modulus [Pa], tendon and gravity of rods that six or twelve pieces are too few
#: for.
RODS = {
    "straight": ([0.012, 0.002], 6e6, "radius_m = 0.0015", ""),
    "winding": ([0.012, 0.004], 6e6, "radius_m = 0.003\nhelix_turns = 0.5", ""),
    "sideways": ([0.012, 0.003], 6e6, "radius_m = 0.002", "gravity_m_s2 = [9.81, 0, 0]"),
    "uniform": ([0.006, 0.006], 1e6, "radius_m = 0.004", ""),
}


@pytest.mark.parametrize("name", RODS)
def test_pieces_that_nobody_says_meet_the_accuracy_against_exact_rods(name, tmp_path):
    robot = read(tmp_path, *RODS[name])
    scene = build_scene(scene_of(robot))
    found, exact = scene.discretization, hanging_rod if any(robot.gravity) else tendon_rod
    for tension in ([8.0], [3.0]):
        truth = exact(robot, np.array(tension), np.array([LENGTH])).tip
        error = np.linalg.norm(scene.tip(scene.equilibrium(np.array(tension))) - truth)
        assert error < found.error < scene.config.wanted_accuracy
    few = build_scene(replace(scene.config, pieces=robot.pieces))
    assert (few.discretization.error > scene.config.wanted_accuracy) == (
        few.layout.pieces < scene.layout.pieces
    )


def test_one_accuracy_holds_for_space_too(tmp_path):
    robot = read(tmp_path, *RODS["straight"])
    counts = {}
    for accuracy in ("1%", "0.1%", "0.03%"):
        scene = build_scene(replace(scene_of(robot), accuracy=accuracy))
        counts[accuracy] = scene.layout.pieces
        assert scene.discretization.error <= scene.config.wanted_accuracy
    assert robot.pieces <= counts["1%"] < counts["0.1%"] < counts["0.03%"]
    assert {n % robot.pieces for n in counts.values()} == {0}


def test_pieces_that_are_said_stay(tmp_path):
    robot = read(tmp_path, *RODS["straight"][:3], "pieces = 4")
    assert not robot.adaptive_pieces
    scene = build_scene(scene_of(robot))
    assert scene.layout.pieces == 4
    assert scene.discretization.error > scene.config.wanted_accuracy
    plain = replace(scene_of(read(tmp_path, *RODS["straight"])), pieces=5)
    assert build_scene(plain).layout.pieces == 5


def test_the_estimate_is_the_error_against_far_more_pieces(tmp_path):
    robot = read(tmp_path, *RODS["winding"])
    for pieces in (12, 24):
        few, many = (build_scene(replace(scene_of(robot), pieces=n)) for n in (pieces, 120))
        tips = [x.tip(x.equilibrium(np.array([8.0]))) for x in (few, many)]
        assert 1 < few.discretization.error / np.linalg.norm(tips[0] - tips[1]) < 3


def test_a_silicone_rod_needs_its_pieces_and_no_more():
    """At full scale its tensions are at their limits, whatever its shape."""
    robot = find_robot("silicone_rod")
    scene = build_scene(scene_of(robot))
    low, high = scene.model.actuator_ctrlrange.T
    ends = robot.length * np.linspace(0, 1, robot.pieces + 1)[1:]
    truth = hanging_rod(robot, np.array([30.0, 0.0, 30.0]), ends).position
    errors = []
    for chain in (build_scene(replace(scene.config, pieces=robot.pieces)), scene):
        q = chain.equilibrium(np.where([True, False, True], high, low))
        errors.append(float(np.linalg.norm(chain.positions(q, ends) - truth, axis=1).max()))
        assert errors[-1] < chain.discretization.error < 2 * errors[-1]
    assert errors[1] < scene.config.wanted_accuracy < errors[0]


def test_a_file_says_pieces_only_where_its_robot_does(tmp_path):
    for more in ("", "pieces = 4"):
        robot = read(tmp_path, *RODS["straight"][:3], more)
        write_robot(robot, tmp_path / "again.toml")
        again = read_robot(tmp_path / "again.toml")
        assert again == robot and again.adaptive_pieces == robot.adaptive_pieces == (not more)


def told(config: SceneConfig) -> str:
    """What building a scene warns of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ResolutionWarning)
        build_scene(config)
    return "; ".join(str(one.message) for one in caught)


def test_what_is_out_of_reach_is_warned_of(tmp_path):
    robot = read(tmp_path, *RODS["straight"])
    sharp = replace(scene_of(robot), accuracy=3e-7)
    assert "mm off, 0.0003 mm are wanted" in told(sharp)
    assert not told(sharp)  # once in a process
    limp = [0.006, 0.006], 3e4, "radius_m = 0.004", "gravity_m_s2 = [0, 0, -9.81]"
    assert "no equilibrium at full scale" in told(scene_of(read(tmp_path, *limp)))


@pytest.mark.parametrize("name", ["straight", "winding", "uniform"])
def test_stretch_and_shear_move_a_rod_as_far_as_is_said(name, tmp_path):
    robot = read(tmp_path, *RODS[name])
    config = replace(scene_of(robot), pieces=24)
    tips = [tendon_rod(robot, np.array([8.0]), np.array([LENGTH]), k).tip for k in (None, 0.75)]
    left_out = build_scene(config).discretization.left_out
    assert left_out == pytest.approx(np.linalg.norm(tips[1] - tips[0]), rel=0.2)


def test_a_member_of_an_assembly_has_the_pieces_that_it_has_alone(tmp_path):
    robot = read(tmp_path, *RODS["sideways"])
    alone = build_scene(scene_of(robot))
    both = build_assembly(Assembly("two", tuple(Member(x, scene_of(robot)) for x in "ab")))
    assert alone.layout.pieces > robot.pieces
    q = both.equilibrium(both.inputs(a=np.array([8.0]), b=np.array([8.0])))
    for name in "ab":
        assert both[name].scene.discretization == alone.discretization
        tip = alone.tip(alone.equilibrium(np.array([8.0])))
        np.testing.assert_allclose(both[name].tip(q), tip, atol=1e-9)


def test_a_robot_is_searched_once(tmp_path):
    robot = read(tmp_path, *RODS["uniform"])
    build_scene(scene_of(robot))
    before = resolution._search.cache_info().misses
    again = build_scene(replace(scene_of(robot), control_period=0.02))
    assert again.discretization.error > 0
    assert resolution._search.cache_info().misses == before


def test_tendons_driven_by_length_lose_tension_as_their_backbone_shortens():
    rod = Section(0.15, 0.003, 1e8, 1050.0, 0.02, 12, poisson_ratio=0.4)
    tendon = Tendon("pull", (0.006, 0.0), 0.15, 0, 30.0, stiffness=2000.0)
    robot = RobotParams(
        "rod", sections=(rod,), tendons=(tendon,), drive=Drive("length", travel=0.012)
    )
    scene, full = build_scene(scene_of(robot)), np.array([0.012])
    tips = [x.tip(x.equilibrium(full)) for x in (scene, beam_of(scene.config, "cosserat", 24))]
    way = float(np.linalg.norm(tips[0] - tips[1]))
    assert scene.discretization.left_out == pytest.approx(way, rel=0.2)
