"""The exact derivative of a chain's static forces, against differences and in Newton's method."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.derivatives import differences
from support.postures import moved

from softrobot_env.robots import CANTILEVER_WEAK, Head, Tendon
from softrobot_env.robots.loads import Load
from softrobot_env.robots.tendons import FeedLine
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.tangent import RubbingForces, StaticForces

LENGTH = CANTILEVER_WEAK.length
HEAD = Head(mass=0.2, centre=0.03, inertia=(1e-4, 1e-4, 1e-4), output=0.05)
BENDING = {
    "planar": {},
    "universal": {"bending": "spatial"},
    "twisting": {"bending": "spatial", "torsion": True},
}


def robot(guides, bending="twisting", **changes):
    """Has gravity from all sides where it moves, and three tendons, one of which ends early."""
    tendons = tuple(
        Tendon(
            f"t{i}",
            (0.02 * np.cos(a), 0.02 * np.sin(a)),
            end * LENGTH,
            0,
            12.0,
            guides=tuple(end * LENGTH * np.array(guides)),
            stiffness=900.0,
            pretension=2.0,
        )
        for i, (a, end) in enumerate(((0.0, 1.0), (2.1, 1.0), (4.2, 0.5)))
    )
    gravity = (1.0, 0.0 if bending == "planar" else -4.0, 3.0)
    return replace(CANTILEVER_WEAK, gravity=gravity, tendons=tendons, **changes)


def loads(bending):
    """Dead and follower loads, in all directions that a chain moves in."""
    force = np.array([1.0, bending != "planar", 1.0])
    moment = np.array([bending != "planar", 1.0, bending == "twisting"])

    def load(name, station, f, m, follows=False):
        return Load(name, station, tuple(force * f), tuple(moment * m), follows)

    return (
        load("dead", 0.4 * LENGTH, (1.0, 2.0, -0.5), (0.1, -0.2, 0.1)),
        load("follower", LENGTH, (0.7, -1.0, 2.0), (0.2, 0.1, -0.3), follows=True),
        load("on_the_base", 0.0, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)),
    )


def slopes(forces, q, ctrl, step=1e-5):
    """Of the force (nv, nv)."""
    model = forces.model
    still = np.zeros(model.nv)
    return differences(lambda x: forces.force(moved(model, q, x), ctrl).copy(), still, step)


def worst(config, ctrl, seed=0):
    """Largest error of the tangent in two postures, relative to its largest entry."""
    forces, rng = StaticForces(build_scene(config).model), np.random.default_rng(seed)
    errors = []
    for size in (0.3, 1.0):
        q = moved(forces.model, forces.model.qpos0, rng.normal(0, size, forces.model.nv))
        truth = slopes(forces, q, ctrl)
        forces.force(q, ctrl)
        errors.append(np.max(np.abs(forces.tangent() - truth)) / np.max(np.abs(truth)))
    return max(errors)


@pytest.mark.parametrize("bending", BENDING)
@pytest.mark.parametrize("channels", ["linear", "guides", "exact"])
def test_tangent_is_the_derivative_of_the_force(bending, channels):
    """On hinges; one tendon winds where a chain twists along exact channels."""
    guides = (0.2, 0.4, 0.7) if channels == "guides" else ()
    params = robot(guides, bending, poisson_ratio=0.4, head=HEAD)
    options = {"pieces": 4, "loads": loads(bending), **BENDING[bending]}
    if channels == "exact":
        options["channels"] = "exact"
        if bending == "twisting":
            tendons = (replace(params.tendons[0], turns=0.8), *params.tendons[1:])
            params = replace(params, tendons=tendons)
    assert worst(SceneConfig(params, **options), np.array([10, 4, 0, 1, 0.6, 1])) < 1e-9
    # One tendon is slack, one taut, and one pulls as much as it may.
    ctrl = np.array([0.05, -0.05, 0.002, 1, 0.6, 1])
    assert worst(SceneConfig(params, actuation="length", **options), ctrl) < 1e-9


@pytest.mark.parametrize(
    ("guides", "changes", "options"),
    [
        ((0.2, 0.4, 0.7), {}, {"rule": "gauss2"}),
        ((), {"precurvature": (1.0, -0.5)}, {}),
        ((), {"precurvature": (1.0, -0.5), "anisotropy": 0.3, "stiff_azimuth": 0.7}, {}),
    ],
    ids=["balls", "precurved", "uneven"],
)
def test_tangent_of_other_joints(guides, changes, options):
    config = SceneConfig(robot(guides, **changes), pieces=4, **BENDING["twisting"] | options)
    model = build_scene(config).model
    assert (model.nq > model.nv) == ("rule" in options)
    assert worst(config, np.array([10.0, 4, 3])) < 1e-9


def test_a_pull_at_the_tip_is_a_dead_load_there():
    own, pull = robot((), bending="universal"), np.array([0.3, -0.2, 0.5])
    load = Load("pull", LENGTH, tuple(pull))
    bare, loaded = (
        StaticForces(build_scene(SceneConfig(own, pieces=4, loads=x, **BENDING["universal"])).model)
        for x in ((), (load,))
    )
    q = np.random.default_rng(0).normal(0, 0.5, bare.model.nv)
    ctrl = np.array([10.0, 4.0, 0.0])
    force = bare.force(q, ctrl, 0.7, pull), loaded.force(q, np.append(ctrl, 1.0), 0.7)
    np.testing.assert_allclose(*force, rtol=1e-12)
    np.testing.assert_allclose(bare.tangent(), loaded.tangent(), rtol=1e-9, atol=1e-9)


def test_what_is_carried_at_the_tip_is_inert():
    """As a heavier head is."""
    tip = replace(HEAD, centre=HEAD.output)
    forces = [
        StaticForces(build_scene(SceneConfig(robot((), "universal", head=x), pieces=4,
                                             **BENDING["universal"])).model)
        for x in (tip, replace(tip, mass=tip.mass + 0.3))
    ]  # fmt: skip
    rng, nv = np.random.default_rng(0), forces[0].model.nv
    motion = 0.5 * rng.standard_normal((3, nv))
    found = forces[0].of_motion(*motion, 0.3)
    np.testing.assert_allclose(found, forces[1].of_motion(*motion), rtol=1e-9, atol=1e-12)


def test_share_scales_all_but_the_joints_springs():
    config = SceneConfig(robot((0.3,)), pieces=4, loads=loads("universal"), bending="spatial")
    forces = StaticForces(build_scene(config).model)
    q = moved(forces.model, forces.model.qpos0, np.full(forces.model.nv, 0.1))
    ctrl = np.array([3.0, 2.0, 1.0, 1.0, 1.0, 1.0])
    parts = []
    for share in (0.0, 0.25, 1.0):
        parts.append((forces.force(q, ctrl, share), forces.tangent()))
    (springs, stiffness), quarter, full = parts
    joints = replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, 0.0))
    alone = StaticForces(build_scene(SceneConfig(joints, pieces=4, bending="spatial")).model)
    np.testing.assert_allclose(springs, alone.force(q, np.zeros(0)), rtol=1e-12)
    np.testing.assert_allclose(stiffness, alone.tangent(), rtol=1e-12)
    for one, other, none in zip(quarter, full, (springs, stiffness), strict=True):
        np.testing.assert_allclose(one, 0.75 * none + 0.25 * other, rtol=1e-12, atol=1e-12)


def test_friction_has_its_derivative_while_tendons_stick_and_slide():
    smooth = robot((0.3, 0.6))
    rubbing = replace(smooth, tendons=tuple(replace(t, friction=0.4) for t in smooth.tendons))
    model = build_scene(SceneConfig(rubbing, actuation="length", bending="spatial")).model
    rng = np.random.default_rng(5)
    q = moved(model, model.qpos0, rng.normal(0, 0.1, model.nv))
    forces, ctrl = RubbingForces(model, q), np.full(model.nu, 5e-3)  # all are taut
    # One tendon slides in, one out, and one sticks: differences must not break it loose.
    forces.anchors[np.flatnonzero(model.tendon_frictionloss)] += (1e-3, -1e-3, 1e-5)
    found = slopes(forces, q, ctrl, step=1e-9)
    rub = forces.force(q, ctrl) - StaticForces(model).force(q, ctrl)
    assert np.abs(forces.tangent() - found).max() < 1e-3 * np.abs(found).max()
    # It pulls a tendon back by 0.4 N where that slides, and by half of it where that sticks.
    arms = mujoco.MjData(model)
    arms.qpos[:] = q
    for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon):
        compute(model, arms)
    turns = np.zeros((model.ntendon, model.nv))
    rows = model.ten_J_rownnz, model.ten_J_rowadr, model.ten_J_colind
    mujoco.mju_sparse2dense(turns, arms.ten_J, *rows)
    wanted = np.zeros(model.ntendon)
    wanted[np.flatnonzero(model.tendon_frictionloss)] = (-0.4, 0.4, -0.2)
    assert rub == pytest.approx(-wanted @ turns, abs=1e-9)
    forces.stay()
    again = forces.force(q, ctrl) - StaticForces(model).force(q, ctrl)
    assert again == pytest.approx(rub, abs=1e-9)


def test_friction_of_the_backbone_has_its_derivative_while_joints_stick_and_slide():
    smooth = robot((0.3, 0.6))
    tendons = tuple(replace(t, friction=0.4) for t in smooth.tendons)
    rubbing = replace(smooth, tendons=tendons, bending_friction=2e-3)
    model = build_scene(SceneConfig(rubbing, pieces=4, bending="spatial")).model
    q = moved(model, model.qpos0, np.linspace(-0.02, 0.03, model.nv))
    away, ctrl = np.zeros(model.nv), np.full(model.nu, 0.3)
    bends = model.dof_frictionloss > 0
    places = np.flatnonzero(bends).reshape(-1, 2)  # of each station
    away[places[::2]] = (0.03, -0.04)  # those slide, the others stick
    forces = RubbingForces(model, moved(model, q, away))
    found = slopes(forces, q, ctrl, step=1e-8)
    assert np.abs(forces.tangent() - found).max() < 1e-4 * np.abs(found).max()
    slack = 0 * ctrl  # whose tendons do not rub
    rub = forces.force(q, slack) - StaticForces(model).force(q, slack)
    assert rub == pytest.approx(2e-3 * away / 0.05, abs=1e-9)


@pytest.mark.parametrize("bending", BENDING)
@pytest.mark.parametrize("channels", ["linear", "guides", "exact"])
def test_friction_along_tendons_has_its_derivative_while_zones_stick_and_slide(channels, bending):
    smooth = robot((0.3, 0.6) if channels == "guides" else (), bending)
    line = FeedLine(2.0, 0.2)
    tendons = tuple(replace(t, friction_coefficient=0.3, feed_line=line) for t in smooth.tendons)
    config = SceneConfig(
        replace(smooth, tendons=tendons),
        pieces=4,
        actuation="length",
        channels="exact" if channels == "exact" else "linear",
        **BENDING[bending],
    )
    model, rng = build_scene(config).model, np.random.default_rng(7)
    q = moved(model, model.qpos0, rng.normal(0, 0.3, model.nv))
    forces = RubbingForces(model, q)
    pulled = forces.tendon_length(model.qpos0) - forces.tendon_length(q)
    ctrl = 5e-3 + pulled[: model.nu]  # all are taut
    assert StaticForces(model).force(q, ctrl) == pytest.approx(forces.force(q, ctrl), abs=1e-9)
    forces.anchors += rng.choice([1e-3, -1e-3, 2e-6], len(forces.anchors))
    found = slopes(forces, q, ctrl, step=1e-8)
    forces.force(q, ctrl)
    assert np.abs(forces.tangent() - found).max() < 1e-5 * np.abs(found).max()
    by_controls, h = forces.by_controls(), 1e-8
    steps = h * np.eye(model.nu)
    found = [(forces.force(q, ctrl + x) - forces.force(q, ctrl - x)) / (2 * h) for x in steps]
    assert np.abs(by_controls - np.array(found).T).max() < 1e-5 * np.abs(by_controls).max()
    rub = forces.force(q, ctrl)
    assert np.abs(rub - StaticForces(model).force(q, ctrl)).max() > 0.01
    forces.stay()
    assert forces.force(q, ctrl) == pytest.approx(rub, abs=1e-9)
