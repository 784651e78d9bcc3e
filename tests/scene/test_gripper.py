"""The gripper: grips against a closed solution, balance of forces, energy."""

from dataclasses import replace
from math import hypot, pi

import numpy as np
import pytest
from support.postures import net_force

from softrobot_env.core.motion import State
from softrobot_env.robots import GRIPPERS, find_robot
from softrobot_env.scene.assembly import CONTACTS, build_assembly, gripper_scene
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.objects import Capsule, Contacts
from softrobot_env.scene.simulation import Simulation
from studies.truths.wrapped_finger import wrapped_finger

FINGER = find_robot("gripper_finger")
GRIPPER = GRIPPERS["gripper"]
WIDTH = FINGER.outer_radius
ACROSS = (pi / 2, 0.0, 0.0)

#: [N/m2], of the skin.
STIFFNESS = 2e6


def arms(robot=FINGER):
    """Lever arms [m] of the tendon at base and tip: a channel pulls along its slope."""
    (_, base, _), (_, tip, _) = robot.tendons[0].knots
    slope = hypot(1.0, (base - tip) / robot.length)
    return base / slope, tip / slope


def exact(tension, radius, robot=FINGER):
    return wrapped_finger(robot.length, robot.bending_stiffness, tension, arms(robot), radius)


def one_finger(radius, pieces=24, pressure=0.0):
    """A finger clamped along a tangent of a cylinder; `radius` is that of its fibre round it.

    A pressure [N/m] presses the skin at the base as deep as it makes it.
    """
    place = radius - pressure / STIFFNESS, 0.0, 0.0
    thing = Capsule(name="object", radius=radius - WIDTH, length=0.1, turn=ACROSS, position=place)
    contacts = Contacts(friction=0.0, stiffness=STIFFNESS)
    config = SceneConfig(
        FINGER, pieces=pieces, rule="midpoint", contacts=contacts, objects=(thing,)
    )
    return build_scene(config)


def at_rest(scene, tension, guess=None):
    u = np.array([tension])
    q = scene.equilibrium(u, guess)
    return q, scene.contacts(State(q, np.zeros(scene.model.nv)), u)


# --- enclosing and fingertip grips ------------------------------------------------------------


@pytest.mark.parametrize(("diameter", "tension"), [(0.048, 25.0), (0.060, 20.0), (0.094, 11.0)])
def test_an_enclosing_grip_is_that_of_an_inextensible_finger(diameter, tension):
    radius = diameter / 2 + WIDTH
    truth = exact(tension, radius)
    scene = one_finger(radius, pressure=truth.base_pressure)
    q, touches = at_rest(scene, tension)
    ends = np.linspace(0, FINGER.length, 25)
    # The skin gives way under the force at the end: the bend there changes over about 6 mm.
    wrapped = scene.curvature(q)[ends[1:] < truth.end - 0.012, 1]
    np.testing.assert_allclose(wrapped, truth.curvature, rtol=5e-3)
    # The first link, half a piece, stands still as the cylinder does, and cannot press on it.
    first = FINGER.length / 48
    lost = truth.pressed() - truth.pressed(first)
    pressed = sum(np.linalg.norm(touch.force) for touch in touches)
    assert pressed == pytest.approx(truth.pressed(first), rel=0.015)
    expected = [lost - truth.force[0], 0.0, truth.force[1]]
    np.testing.assert_allclose(net_force(touches, "backbone"), expected, atol=0.015 * pressed)
    middle = [t for t in touches if 0.2 < t.stations[0] / truth.end < 0.6]
    found = sum(np.linalg.norm(touch.force) for touch in middle)
    line = sum(truth.pressure(touch.stations[0]) for touch in middle) * FINGER.length / 24
    assert found == pytest.approx(line, rel=0.03)


# --- energy -----------------------------------------------------------------------------------


def test_what_the_tendon_gives_is_what_the_finger_stores():
    """d(U - T w) / dT = -w at rest, w being what is wound up: nothing else works."""
    scene, tension, step = one_finger(0.033), 18.0, 0.5
    model, full = scene.model, FINGER.tendons[0].straight_length

    def at(value):
        q, _ = at_rest(scene, value)
        stored = 0.5 * float(model.jnt_stiffness @ q**2)
        return stored, full - float(scene.tendon_length(q)[0])

    (below, w0), (_, w), (above, w1) = (at(tension + k * step) for k in (-1, 0, 1))
    change = (above - (tension + step) * w1) - (below - (tension - step) * w0)
    assert change / (2 * step) == pytest.approx(-w, rel=2e-3)
    assert above - below == pytest.approx(tension * (w1 - w0), rel=0.03)


# --- where a fingertip grip comes from --------------------------------------------------------


def tip_of(tip_arm=0.001, friction=0.8, tension=38.0):
    """Bend of the last sensor [deg] and share of the outer force at the tip, round 48 mm."""
    finger = GRIPPER.fingers[1]
    tendon = finger.robot.tendons[0]
    route = ((FINGER.length, tip_arm, 0.0),)
    robot = replace(finger.robot, tendons=(replace(tendon, route=route),))
    built = build_assembly(
        gripper_scene(
            replace(GRIPPER, fingers=(replace(finger, robot=robot),)),
            (lying(0.024),),
            contacts=replace(CONTACTS, friction=friction),
            timestep=2e-4,
        )
    )
    simulation, steps = Simulation(built), 120
    simulation.reset(built.model.qpos0, np.zeros(1))
    for k in range(steps):
        simulation.ctrl[:] = tension * (k + 1) / steps
        assert simulation.advance(), simulation.failure()
    bends = built["middle"].curvature(simulation.posture)[:, 1].reshape(3, -1).mean(axis=1)
    outer = [t for t in simulation.contacts() if t.stations[0] and t.stations[0] > 0.036]
    forces = np.array([np.linalg.norm(t.force) for t in outer])
    tip = np.array([t.stations[0] > 0.081 for t in outer])
    return np.degrees(bends[2]) * 0.03, forces[tip].sum() / forces.sum()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
def test_round_48_mm_friction_keeps_what_a_low_arm_at_the_tip_would_lift_off():
    """Pull and pressure both grow with the tension: friction locks the wrapped part at any."""
    bend, share = tip_of()
    assert share < 0.5
    twice, same = tip_of(tension=76.0)
    assert same < 0.5 and twice < bend + 6
    slippery, more = tip_of(friction=0.1)
    assert more > 0.5 and slippery > bend + 2
    long, most = tip_of(tip_arm=0.002)
    assert most > 0.5 and long > bend + 10


# --- three fingers ----------------------------------------------------------------------------


def gripped(objects, tension, push, **options):
    """Three fingers close for 1 s; then a force (3,) [N] pulls at the object for another."""
    built = build_assembly(gripper_scene(GRIPPER, objects, **options))
    simulation = Simulation(built)
    simulation.reset(built.model.qpos0, np.zeros(3))
    for k in range(100):
        simulation.ctrl[:] = tension * min(1.0, k / 20)
        if k == 50:
            simulation.data.xfrc_applied[built.model.body("object").id, :3] = push
        assert simulation.advance(), simulation.failure()
    return simulation


def lying(radius=0.03, **options):
    height = GRIPPER.seat(radius) + 2e-4
    return Capsule(
        name="object", radius=radius, length=0.08, turn=ACROSS, position=(0, 0, height), **options
    )


@pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")
def test_three_fingers_hold_a_free_object_against_a_pull():
    """At rest the contacts carry its weight and the pull, in all three directions."""
    mass, push = 0.08, np.array([0.3, 0.2, 1.2])
    simulation = gripped((lying(mass=mass),), 20.0, push, pieces=6, timestep=1e-3)
    weight = mass * np.array(GRIPPER.gravity)
    force = net_force(simulation.contacts(), "object")
    np.testing.assert_allclose(force, -weight - push, atol=0.01)
    assert np.abs(simulation.data.qvel[-6:]).max() < 0.01
    pressing = {t.first for t in simulation.contacts() if t.second == "object"}
    assert {"left/backbone", "middle/backbone", "right/backbone"} <= pressing
    assert not any("backbone" in t.second for t in simulation.contacts())


def test_what_is_seated_touches_nothing_yet():
    for radius in (0.0225, 0.05):
        built = build_assembly(gripper_scene(GRIPPER, (lying(radius, mass=0.1),)))
        assert built.contacts() == ()
        low = replace(lying(radius), position=(0, 0, GRIPPER.seat(radius) - 1e-4))
        touching = build_assembly(gripper_scene(GRIPPER, (replace(low, mass=0.1),)))
        assert touching.contacts()


def test_the_gripper_has_as_many_pieces_as_robots_that_touch():
    built = build_assembly(gripper_scene(GRIPPER, (lying(),)))
    assert {part.scene.config.n_pieces for part in built.parts.values()} == {24}
    names = [built.model.pair(k).name for k in range(built.model.npair)]
    assert len(names) == 3 * 23 + 3 * 23  # object and palm, and no finger with another
    assert CONTACTS.friction > 0
