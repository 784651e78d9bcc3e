"""Derivatives of equilibria of beam models against differences of equilibria."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from softrobot_env.beams.ancf import ANCF
from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.pcc import PCC
from softrobot_env.gradients.beams import BeamRest
from softrobot_env.gradients.parameters import Parameter, parameter
from softrobot_env.robots import ARM, Base, Tendon

BENT = replace(ARM, gravity=(1.0, 0.0, -9.81), poisson_ratio=0.3)
WOUND = replace(
    BENT,
    base=Base((0.1, 0.2, 0.3), (1.0, 0.5, -1.0)),
    tendons=(
        Tendon("a", (0.02, 0.0), ARM.length, 0, 20.0, stiffness=3e3),
        Tendon("b", (-0.01, 0.02), 0.5 * ARM.length, 1, 20.0, stiffness=3e3),
    ),
)

#: Models of a robot, its inputs, and the numbers it may differ by.
CASES = {
    "pcc": (partial(PCC, pieces=6, axes="spatial"), WOUND),
    "pcc by length": (partial(PCC, pieces=6, axes="torsion", drive="length"), WOUND),
    "cosserat": (partial(CosseratRod, pieces=8), WOUND),
    "ancf": (partial(ANCF, pieces=4, dimension=3), WOUND),
    "planar ancf": (partial(ANCF, pieces=4, dimension=2), BENT),
}


def longer(robot, factor):
    """A robot with all along it as many times longer."""
    tendons = tuple(replace(t, end=factor * t.end) for t in robot.tendons)
    return replace(robot, length=factor * robot.length, tendons=tendons)


NAMED = "youngs_modulus", "density", "tendons.0.offset.0", "gravity.0"
NUMBERS = [*NAMED, Parameter("longer", longer, 1.0, 1.0)]


@pytest.mark.parametrize("name", CASES)
def test_derivatives_are_those_of_equilibria(name):
    build, robot = CASES[name]
    rng = np.random.default_rng(1)
    length = build(robot).drive == "length"
    inputs = rng.uniform(0.2, 1.0, len(robot.tendons)) * (4e-3 if length else 4.0)
    rest = BeamRest(build, robot, inputs, NUMBERS)
    weights = rng.normal(size=rest.points.shape)
    by_inputs, by_numbers = rest.vjp(weights)

    def value(robot, inputs):
        return (weights * BeamRest(build, robot, inputs, guess=rest.q).points).sum()

    for k, step in enumerate(np.eye(len(inputs)) * 1e-3 * inputs.max()):
        truth = extrapolated(lambda share, s=step: value(robot, inputs + share * s)) / step[k]
        assert by_inputs[k] == pytest.approx(truth, rel=1e-6, abs=1e-9)
    for one in (*(parameter(robot, name) for name in NAMED), NUMBERS[-1]):
        step = 1e-3 * one.scale

        def changed(share, one=one, step=step):
            return value(one.apply(robot, one.value + share * step), inputs)

        truth = extrapolated(changed) / step
        assert by_numbers[one.name] == pytest.approx(truth, rel=1e-6, abs=1e-9)


def extrapolated(value):
    """Slope at zero, of fourth order."""
    far, near = ((value(h) - value(-h)) / (2 * h) for h in (1.0, 0.5))
    return (4 * near - far) / 3


def test_points_between_and_what_is_refused():
    build, robot = CASES["pcc"]
    rest = BeamRest(build, robot, [5.0, 2.0], stations=np.array([0.1, 0.3]))
    assert rest.points.shape == (2, 3)
    tip = BeamRest(build, robot, [5.0, 2.0], stations=np.array([robot.length]))
    weights = np.array([[1.0, 2.0, 3.0]])
    same = BeamRest(build, robot, [5.0, 2.0]).vjp(weights)[0]
    np.testing.assert_allclose(tip.vjp(weights)[0], same, rtol=1e-12)
    with pytest.raises(ValueError, match="weights of points"):
        rest.vjp(weights)
    with pytest.raises(ValueError, match="no number"):
        BeamRest(build, robot, [5.0, 2.0], ["name"])
