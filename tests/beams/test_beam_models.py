"""The beam models against each other and against closed forms, through their common class."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.distance import pdist

from softrobot_env.beams import signals
from softrobot_env.beams.ancf import ANCF
from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.model import State
from softrobot_env.beams.pcc import PCC
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.robots import ARM, CANTILEVER_STIFF, CANTILEVER_WEAK, Tendon
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from studies.truths.continuum_arc import continuum_arc

FREE = (0.0, 0.0, 0.0)
LENGTH = CANTILEVER_WEAK.length
WEIGHTLESS = replace(CANTILEVER_WEAK, gravity=FREE)

#: Guides every 25 mm and tendons that can be driven by length.
GUIDED = replace(
    WEIGHTLESS,
    tendons=tuple(
        Tendon(
            f"t{k}",
            (0.03 * np.cos(a), 0.03 * np.sin(a)),
            LENGTH,
            0,
            50.0,
            guides=tuple(np.arange(1, 20) * LENGTH / 20),
            stiffness=2e3,
            pretension=0.5,
        )
        for k, a in enumerate(np.deg2rad([0, 120, 240]))
    ),
)


PUSH = Load("push", LENGTH, force=(1.0, 0.0, 0.0))

#: Compiling the continuum takes long.
NAMES = ["pcc", "cosserat", pytest.param("ancf", marks=pytest.mark.slow)]


def model_of(name, robot, n, **options):
    if name == "pcc":
        return PCC(robot, n, axes="torsion", inertia="distributed", **options)
    return {"cosserat": CosseratRod, "ancf": ANCF}[name](robot, n, **options)


def models(robot, n, **options):
    return {name: model_of(name, robot, n, **options) for name in ("pcc", "cosserat", "ancf")}


def chain(robot, loads, **options):
    return build_scene(SceneConfig(robot, pieces=8, loads=loads, **options))


# ---------------------------------------------------------------- statics


@pytest.mark.slow  # compiling all models takes a minute
def test_models_agree_in_space_under_a_force_and_a_moment():
    force = np.array([0.3, -0.2, -0.1])
    load = Load("load", LENGTH, force=tuple(force), moment=(0.05, 0.1, 0.08))
    found = {
        name: model.tip(model.equilibrium([1.0], load_steps=4, check_stability=False))
        for name, model in models(WEIGHTLESS, 16, loads=(load,)).items()
    }
    shear_stiffness = 0.75 * WEIGHTLESS.youngs_modulus / 2 * WEIGHTLESS.area
    shear = np.linalg.norm(force) * LENGTH / shear_stiffness
    assert np.linalg.norm(found["cosserat"] - found["ancf"]) < 1e-3 * LENGTH
    assert pdist(list(found.values())).max() < shear + 1e-3 * LENGTH


def bent_tip(pieces):
    """Tip (3,) of arcs in the plane, each (reference length, stretch, curvature per reference)."""
    z, angle = 0.0, 0.0
    for length, stretch, curvature in pieces:
        half = curvature * length / 2
        z += stretch * length * np.sinc(half / np.pi) * np.exp(1j * (angle + half))
        angle += 2 * half
    return np.array([z.imag, 0.0, z.real])


@pytest.mark.slow  # compiling it takes long
def test_tendons_in_channels_bend_the_continuum_as_its_physics_asks():
    """Of St. Venant and Kirchhoff's material, within 0.1 %."""
    model, part = ANCF(ARM, 24), ARM.length / 3
    tip = model.tip(model.equilibrium(np.array([4.0, 0, 3.0, 0, 5.0, 0]), load_steps=4))
    pieces = [(part, *continuum_arc(ARM, 0.0, f, ARM.outer_radius)) for f in (12.0, 8.0, 5.0)]
    assert np.linalg.norm(tip - bent_tip(pieces)) < 1e-3 * ARM.length


@pytest.mark.slow  # compiling all models takes a minute
def test_length_drive_is_the_tension_drive_at_the_tension_it_causes():
    for name, model in models(GUIDED, 20, drive="length").items():
        pull = np.array([0.02, 0.0, -0.01])
        q = model.equilibrium(pull, load_steps=4)
        tension = model.tendon_tension(q, pull)
        assert tension.min() >= 0, name
        assert tension.max() > 1, name
        straight = GUIDED.tendons[0].end
        stretch = pull - straight + model.tendon_length(q)
        np.testing.assert_allclose(tension, np.maximum(0, 0.5 + 2e3 * stretch), atol=1e-9)
        other = type(model)(GUIDED, 20, **({"axes": "torsion"} if name == "pcc" else {}))
        same = other.equilibrium(tension, guess=q)
        assert np.linalg.norm(other.tip(same) - model.tip(q)) < 1e-8, name


@pytest.mark.parametrize(
    ("make", "within"),
    [
        (partial(PCC, WEIGHTLESS, 8), 0.02),
        (partial(chain, WEIGHTLESS), 0.02),
        (partial(chain, WEIGHTLESS, bending="spatial"), 0.02),
        *(
            pytest.param(
                partial(ANCF, WEIGHTLESS, pieces, dimension=2), 0.1, marks=pytest.mark.slow
            )
            for pieces in (8, 48)
        ),
    ],
)
def test_unstable_equilibrium_is_refused(make, within):
    """A column under more than Euler's load pi^2 EI / (2 L)^2 buckles."""
    critical = np.pi**2 * WEIGHTLESS.bending_stiffness / (2 * LENGTH) ** 2
    model = make(loads=(Load("press", LENGTH, force=(0.0, 0.0, -1.0)),))
    q = model.equilibrium(np.array([(1 - within) * critical]))
    assert np.abs(model.tip(q)[:2]).max() < 1e-12
    with pytest.raises(EquilibriumError, match="unstable"):
        model.equilibrium(np.array([(1 + within) * critical]))


@pytest.mark.parametrize(
    "make",
    [
        partial(PCC, pieces=16, axes="planar", inertia="distributed"),
        pytest.param(partial(CosseratRod, pieces=24), marks=pytest.mark.slow),
        chain,
        partial(chain, bending="spatial"),
    ],
    ids=["pcc", "cosserat", "planar chain", "spatial chain"],
)
def test_becks_column_flutters_and_never_buckles(make):
    """A follower force along the tip: flutter from 20.05 EI / L^2 on, undamped (Beck 1952)."""
    robot = replace(WEIGHTLESS, damping_time=0.0, outer_radius=LENGTH / 400, inner_radius=0.0)
    force = (0.0, 0.0, -robot.bending_stiffness / LENGTH**2)
    model = make(robot, loads=(Load("press", LENGTH, force=force, follows=True),))
    for share, kind in ((19.7, "static"), (19.7, "dynamic"), (20.4, "static")):
        q = model.equilibrium(np.array([share]), check_stability=kind)
        assert np.abs(model.tip(q)[:2]).max() < 1e-12
    with pytest.raises(EquilibriumError, match=r"flutters.*check_stability='static'"):
        model.equilibrium(np.array([20.4]), check_stability="dynamic")


# ---------------------------------------------------------------- dynamics


@pytest.mark.filterwarnings("ignore::softrobot_env.beams.ancf.LockingWarning")
@pytest.mark.parametrize("name", NAMES)
def test_scipy_solves_the_same_right_hand_side(name):
    model = model_of(name, CANTILEVER_WEAK, 2)
    start = model.start()
    motion = model.simulate(0.5, tolerance=1e-7)
    y0 = np.concatenate(start)
    found = solve_ivp(
        model.first_order(np.zeros(model.n_inputs)), (0, 0.5), y0, "LSODA", rtol=1e-8, atol=1e-9
    )
    end = model.tip(found.y[: model.n, -1])
    assert np.linalg.norm(end - model.tip(motion.q)[-1]) < 2e-5


@pytest.mark.parametrize("name", NAMES)
def test_linear_model_predicts_small_motions(name):
    model = model_of(name, WEIGHTLESS, 4, loads=(PUSH,))
    q = model.equilibrium([0.2])
    space = model.linearize(State(q, np.zeros(model.n)), [0.2])
    assert space.poles().real.max() < 1e-6
    small, duration = 1e-4, 0.3
    motion = model.simulate(
        duration, [0.2 + small], State(q, np.zeros(model.n)), tolerance=1e-9, samples=0.03
    )
    moved = model.tip(motion.q) - model.tip(q)
    m = space.a.shape[0]
    augmented = np.zeros((m + 1, m + 1))
    augmented[:m, :m], augmented[:m, m:] = space.a, space.b * small
    flow, x = expm(augmented * 0.03), np.append(np.zeros(m), 1.0)
    predicted = [np.zeros(3)]
    for _ in motion.time[1:]:
        x = flow @ x
        predicted.append(space.c @ x[:m])
    assert np.max(np.abs(moved - predicted)) < 2e-3 * np.max(np.abs(moved))


def test_control_affine_form_is_the_equation_of_motion():
    rng = np.random.default_rng(1)
    for drive in ("tension", "length"):
        model = PCC(GUIDED, 5, axes="torsion", drive=drive)
        q, v, a = (rng.normal(size=model.n) * s for s in (0.5, 5, 50))
        u = np.array([6.0, 2.0, 4.0]) if drive == "tension" else np.full(3, 0.015)
        form = model.control_affine(q, v)
        assert drive == "tension" or model.tendon_tension(q, u).min() > 0
        balance = form.mass @ a + form.gyroscopic - form.force - form.inputs @ u
        np.testing.assert_allclose(balance, model.residual(q, v, a, u), rtol=1e-9, atol=1e-10)


def test_a_signal_moves_the_rod_as_its_pieces_do():
    model = PCC(WEIGHTLESS, 2, loads=(PUSH,))
    values = np.array([[0.3], [-0.2], [0.1]])
    whole = model.simulate(0.3, signals.held(values, 0.1), method="sdirk2", step=1e-3)
    state = model.start()
    for value in values:
        state = model.simulate(0.1, value, state, method="sdirk2", step=1e-3).end
    np.testing.assert_allclose(state.q, whole.q[-1], atol=1e-7)


# ---------------------------------------------------------------- arguments and failures


@pytest.mark.parametrize(
    ("act", "allowed"),
    [
        (lambda m: m.acceleration(m.rest(), m.rest(), [1.0, 2.0]), r"shape \(1,\) for push"),
        (lambda m: m.acceleration(np.zeros(2), np.zeros(6)), r"shape \(6,\)"),
        (lambda m: m.simulate(0.1, start=State(np.zeros(2), np.zeros(2))), r"shape \(6,\)"),
        (lambda m: m.simulate(1.0, method="euler"), "choose from implicit_euler"),
        (lambda m: m.simulate(1.0, method="implicit_euler"), "needs a step"),
        (lambda m: m.simulate(0.0), "positive"),
        (lambda m: m.simulate(1.0, samples=np.array([0.5, 1.0])), "start at 0"),
        (lambda m: m.simulate(1.0, samples=0.4), "must divide"),
        (lambda m: m.simulate(1.0, samples=[0, 0.2]), "end at the duration"),
        (lambda m: m.simulate(1.0, signals.constant([1.0, 2.0])), "signal has 2 inputs"),
        (lambda m: m.positions(m.rest(), [0.2, 5.0]), r"between 0 and 0\.5"),
        (lambda m: m.equilibrium(load_steps=0), "whole number"),
        (lambda m: m.equilibrium(check_stability="both"), "True, False, 'static', 'dynamic'"),
        (lambda m: PCC(WEIGHTLESS, 2, loads=(replace(PUSH, station=0.6),)), "off the robot"),
        (lambda m: PCC(WEIGHTLESS, 2, loads=(PUSH, PUSH)), "need different names"),
        (lambda m: PCC(ARM, drive="length"), "finite stiffness"),
        (lambda m: PCC(ARM, drive="current"), "tension, length"),
        *(
            case
            for x in (np.nan, np.inf)
            for case in (
                (lambda m, x=x: m.equilibrium([x]), "inputs must be finite, got 'push'"),
                (lambda m, x=x: m.simulate(0.1, [x]), "inputs must be finite"),
                (lambda m, x=x: m.equilibrium([1.0], guess=np.full(m.n, x)), "states must be"),
                (
                    lambda m, x=x: m.simulate(0.1, start=State(m.rest(), np.full(m.n, x))),
                    "states must be finite",
                ),
                (
                    lambda m, x=x: m.simulate(0.1, signals.held(np.array([[0.0], [x]]), 0.1)),
                    "coefficients must be finite",
                ),
                (
                    lambda m, x=x: Load("bad", LENGTH, moment=(0.0, x, 0.0)),
                    r"'bad': moment.*must be a finite number",
                ),
            )
        ),
    ],
)
def test_arguments_name_what_is_allowed(act, allowed):
    model = PCC(WEIGHTLESS, 3, loads=(PUSH,))
    with pytest.raises(ValueError, match=allowed):
        act(model)


def test_short_pulses_are_not_jumped_over():
    """At rest the error estimate is zero, so only the inputs' own instants stop the step."""
    model = PCC(WEIGHTLESS, 2, axes="planar", loads=(PUSH,))
    for begin in (60, 90, 130):
        values = np.zeros((200, 1))
        values[begin : begin + 3] = 2.0
        pulse = signals.held(values, 0.05)
        adapted = model.simulate(10.0, pulse, samples=0.05, tolerance=1e-7)
        fixed = model.simulate(10.0, pulse, samples=0.05, method="sdirk4", step=0.005)
        assert np.max(np.abs(fixed.q)) > 0.5
        np.testing.assert_allclose(adapted.q, fixed.q, atol=2e-3)


@pytest.mark.parametrize(
    ("method", "step"),
    [("sdirk4", 0.02), ("implicit_midpoint", 0.02), ("sdirk2", 0.02), ("dormand_prince", 0.004)],
)
def test_samples_beside_a_jump_know_nothing_of_what_comes(method, step):
    model = PCC(WEIGHTLESS, 2, axes="planar", loads=(PUSH,))
    jump = signals.held(np.array([[0.0], [1.0]]), 0.1)
    coarse = model.simulate(0.2, jump, method=method, step=step, samples=0.004)
    assert np.max(np.abs(coarse.q[:26])) < 1e-12
    # Right after it the quintic is as good as the steps themselves.
    fine = model.simulate(0.2, jump, tolerance=1e-9, samples=0.004)
    at_steps = np.max(np.abs((coarse.q - fine.q)[::5]))
    assert np.max(np.abs(coarse.q - fine.q)) < 3 * at_steps + 1e-4


def test_fixed_steps_end_at_the_end():
    model = PCC(replace(CANTILEVER_STIFF, gravity=FREE), 1, axes="planar")
    for duration, step in ((20.0, 1e-3), (5.0, 5e-4)):
        motion = model.simulate(duration, method="sdirk2", step=step)
        assert motion.steps == round(duration / step)
