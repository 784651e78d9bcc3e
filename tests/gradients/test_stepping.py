"""Derivatives of motions by MuJoCo's integrators, against differences of the same runs."""

import pickle
from collections.abc import Callable, Iterator
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mujoco import MjContact, MjData

from softrobot_env.core.motion import State
from softrobot_env.gradients import Rollout
from softrobot_env.gradients.parameters import parameter
from softrobot_env.gradients.stepping import SteppedMotion
from softrobot_env.robots import find_robot
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.objects import Contacts, Ground, Sphere

# A timestep with which tests are quick is not accurate.
pytestmark = pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")

FINGER = find_robot("planar_finger")
PARAMETERS = ("youngs_modulus", "density", "damping_time", "tendons.0.offset.0")

RUBBING = FINGER.with_sections(*(replace(x, bending_friction=2e-4) for x in FINGER.sections))

#: Into a ball, which the finger presses on and slides along; and what else MuJoCo has to compute.
BALL = Sphere(name="ball", position=(0.03, 0.0, 0.084), radius=0.0144)
COARSE = {"pieces": 6, "timestep": 1e-4}
CASES = {
    "sticks": {"contacts": Contacts(stiffness=2e3), "objects": (BALL,), **COARSE},
    "slides": {"contacts": Contacts(stiffness=2e3, friction=0.05), "objects": (BALL,), **COARSE},
    "smooth": {"contacts": Contacts(stiffness=2e3, friction=0.0), "objects": (BALL,), **COARSE},
    "implicitfast": {"integrator": "implicitfast"},
    "Euler": {"integrator": "Euler"},
}


def built(config: SceneConfig) -> Scene:
    """A scene whose constraints are solved to all digits, as differences of runs need it."""
    scene = build_scene(config)
    scene.model.opt.tolerance, scene.model.opt.iterations = 1e-15, 200
    return scene


def difference(function: Callable[[float], float], step: float) -> float:
    once, twice = ((function(h) - function(-h)) / (2 * h) for h in (step, step / 2))
    return (4 * twice - once) / 3


def weighed(weights: dict, observed: object) -> float:
    return sum(float((x * getattr(observed, name)).sum()) for name, x in weights.items())


def pulled(scene: Scene, periods: int = 6) -> np.ndarray:
    """Tensions that press the finger against the ball."""
    high = scene.model.actuator_ctrlrange[:, 1]
    inputs = np.full((periods, len(high)), 0.05) * high
    inputs[:, 0] = high[0] * np.linspace(0.3, 0.4, periods)
    return inputs


def touches(scene: Scene, motion: SteppedMotion) -> Iterator[tuple[MjContact, np.ndarray]]:
    """Contacts where periods begin, and their forces: normal and sideways."""
    data = MjData(scene.model)
    for begin, control in zip(motion._starts, motion._controls[1:], strict=True):
        data.qpos[:], data.qvel[:], data.ctrl[:] = begin[0], begin[1], control
        mujoco.mj_forward(scene.model, data)
        for contact in data.contact:
            yield contact, data.efc_force[contact.efc_address :][: contact.dim]


@pytest.mark.parametrize("name", CASES)
def test_derivatives_are_those_of_runs(name):
    scene = built(SceneConfig(FINGER, **CASES[name]))
    rollout, inputs = Rollout(scene, PARAMETERS), pulled(scene)
    rng = np.random.default_rng(0)
    start = State(0.03 * np.ones(scene.model.nv), 0.1 * rng.normal(size=scene.model.nv))
    motion = rollout.run(inputs, start)
    weights = {k: rng.normal(size=x.shape) for k, x in motion.observed._asdict().items()}
    found = motion.vjp(**weights)
    way, change = State(*rng.normal(size=(2, scene.model.nv))), rng.uniform(-1, 1, inputs.shape)
    assert any(True for _ in touches(scene, motion)) == ("contacts" in CASES[name])

    def run(own: Scene, given: np.ndarray, state: State) -> float:
        return weighed(weights, Rollout(own).run(given, state).observed)

    cases = {
        "start": (
            found.position @ way.q + found.velocity @ way.v,
            lambda e: run(scene, inputs, State(start.q + e * way.q, start.v + e * way.v)),
        ),
        "inputs": (
            float((found.inputs * change).sum()),
            lambda e: run(scene, inputs + e * change, start),
        ),
    }
    for one in (parameter(FINGER, own) for own in PARAMETERS):

        def varied(e, one=one):
            other = replace(
                scene.config,
                robot=one.apply(FINGER, one.value + e * one.scale),
                timestep=scene.timestep.timestep,
            )
            return run(built(other), inputs, start)

        cases[one.name] = one.scale * found.parameters[one.name], varied
    largest = max(abs(wanted) for wanted, _ in cases.values())
    along = motion.jvp(start=way, inputs=change)
    both = cases["start"][0] + cases["inputs"][0]
    assert abs(weighed(weights, along) - both) < 1e-10 * largest
    for own, (wanted, function) in cases.items():
        assert abs(difference(function, 1e-6) - wanted) < 1e-6 * largest, own


def test_contacts_that_slide_and_stick_are_met():
    """Both laws of friction are among the cases."""
    shares = []
    for name in ("sticks", "slides"):
        scene = built(SceneConfig(FINGER, **CASES[name]))
        motion = Rollout(scene).run(pulled(scene, 12))
        slipping = []
        for contact, force in touches(scene, motion):
            slipping.append(np.hypot(*force[1:]) > 0.99 * contact.friction[0] * force[0])
        shares.append(np.mean(slipping))
    assert shares[0] < 0.5 < shares[1]


def test_what_is_not_derived_is_said():
    with pytest.raises(ValueError, match="the integrator RK4"):
        Rollout(build_scene(SceneConfig(FINGER, integrator="RK4")))
    with pytest.raises(ValueError, match="the integrator discrete"):  # of friction of the backbone
        Rollout(build_scene(SceneConfig(RUBBING)))
    ground = Ground(name="ground", position=(0.0, 0.0, 0.1))
    contacts = Contacts(stiffness=2e3, friction=0.0)
    config = SceneConfig(FINGER, contacts=contacts, objects=(ground,), **COARSE)
    with pytest.raises(ValueError, match="in which it touches"):
        Rollout(build_scene(config)).rest(np.zeros(4))


def test_a_copy_has_the_same_derivatives():
    scene = build_scene(SceneConfig(FINGER, integrator="implicitfast", timestep=1e-3))
    rollout, inputs = Rollout(scene, PARAMETERS[:1]), pulled(scene, 2)
    wanted = rollout.run(inputs).vjp(tip=np.ones((3, 3)))
    again = pickle.loads(pickle.dumps(rollout)).run(inputs).vjp(tip=np.ones((3, 3)))
    np.testing.assert_array_equal(again.inputs, wanted.inputs)
    assert again.parameters == wanted.parameters
