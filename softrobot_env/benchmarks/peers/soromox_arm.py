"""The arm's tension step in SoRoMoX, where it is installed, and in our models beside it.

The robot is the arm, made solid (SoRoMoX has no hollow sections) and hung up under gravity. Only
bending strains are active there (`PlanarPCS`, the planar of its models), so all of the models
converge to the same rod that does not shear or stretch: the limit of our PCC model with the inertia
of its sections. SoRoMoX damps by the modulus eta: eta times three times the moment of area per
curvature rate. Each is integrated by the methods that its package offers; SoRoMoX also by the
implicit ones of diffrax, which are far faster here than Tsit5, which its rollouts use unless told.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.metadata import version
from time import process_time
from typing import Any

import numpy as np
from scipy.optimize import root

from softrobot_env.benchmarks.accuracy.cases import tension_step as case
from softrobot_env.benchmarks.accuracy.cases.beam_models import DISTRIBUTED
from softrobot_env.benchmarks.accuracy.cases.motions import TimedMotion, beam_limit
from softrobot_env.benchmarks.accuracy.rows import DURATION, Limit
from softrobot_env.benchmarks.peers.rows import OURS, Row
from softrobot_env.benchmarks.timing import best_of
from softrobot_env.robots import ARM

PEER = "soromox"

#: Gravity acts towards the tip.
ROBOT = replace(ARM, inner_radius=0.0, gravity=(0.0, 0.0, 9.81))

_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)


def truth(quick: bool) -> Limit:
    """The motion with infinitely many pieces."""
    return beam_limit(case.beam_motion, DISTRIBUTED, (3, 6, 12) if quick else (6, 12, 24), ROBOT)


def our_rows(limit: Limit, quick: bool) -> Iterator[Row]:
    """The MuJoCo chain and the PCC model."""
    for n in (6, 12) if quick else (6, 12, 24, 48):
        for timestep in (1e-3, 2e-3, 5e-3, 1e-2):
            for integrator in ("implicitfast", "discrete"):
                yield _our_row(limit, case.chain_motion("gauss2", n, timestep, integrator, ROBOT))
    for n in (3, 6) if quick else (3, 6, 12):
        for tolerance in _TOLERANCES:
            motion = replace(case.beam_motion(DISTRIBUTED, n, ROBOT), tolerance=tolerance)
            yield _our_row(limit, motion)


def _our_row(limit: Limit, motion: TimedMotion) -> Row:
    motion()  # compiles
    seconds, tips = best_of(motion, 5, process_time)
    set_by = motion.settings
    return Row(
        "motion",
        OURS,
        version(OURS),
        set_by.model,
        set_by.n,
        set_by.integrator,
        None if set_by.tolerance else set_by.timestep,
        set_by.tolerance,
        **_errors(limit, tips),
        core_seconds=seconds / DURATION,
    )


def _errors(limit: Limit, tips: np.ndarray) -> dict[str, Any]:
    error = np.linalg.norm(tips - limit.tips, axis=1)
    return {"e_mean": float(error.mean()), "e_max": float(error.max()), "text": limit.text}


def peer_rows(limit: Limit, quick: bool) -> Iterator[Row]:
    """SoRoMoX by number of segments, integrator and tolerance."""
    for n in (3,) if quick else (3, 6, 12):
        for integrator in ("Kvaerno5",) if quick or n > 6 else ("Kvaerno5", "Kvaerno3", "Tsit5"):
            simulate, compiled = _motion(n, integrator), None
            for tolerance in _TOLERANCES[:2] if integrator == "Tsit5" else _TOLERANCES:
                first, _ = best_of(lambda t=tolerance, f=simulate: f(t), 1, process_time)
                seconds, tips = best_of(lambda t=tolerance, f=simulate: f(t), 3, process_time)
                compiled = first - seconds if compiled is None else compiled
                yield Row(
                    "motion",
                    PEER,
                    version(PEER),
                    "PlanarPCS",
                    n,
                    integrator,
                    None,
                    tolerance,
                    **_errors(limit, tips),
                    core_seconds=seconds / DURATION,
                    compiled=compiled,
                )


def _motion(n: int, integrator: str) -> Callable[[float], np.ndarray]:
    """A function that simulates the motion by a tolerance, with tips (300, 2) in (x, z) [m]."""
    import diffrax
    import jax
    from soromox.actuation import ThreadlikeActuator, ThreadlikeRouting
    from soromox.systems import LinkSpec, PlanarPCS, PlanarPCSStructure, SystemState

    jax.config.update("jax_enable_x64", True)
    jnp = jax.numpy
    link = LinkSpec.circular(
        length=ROBOT.length / n,
        radius=ROBOT.outer_radius,
        density=ROBOT.density,
        reference_strain=[0, 1, 0],
        young_modulus=ROBOT.youngs_modulus,
        poisson_ratio=0.0,
        material_damping_coefficient=ROBOT.damping_time * ROBOT.youngs_modulus / 3,
    )
    routing = ThreadlikeRouting.linear(
        intercept=jnp.array([[0, -tendon.offset[0], 0] for tendon in ROBOT.tendons]),
        end_segment_index=tuple(round(t.end / ROBOT.length * n) - 1 for t in ROBOT.tendons),
    )
    robot = PlanarPCS.from_links(
        [link] * n,
        structure=PlanarPCSStructure(strain_selector=jnp.array([True, False, False] * n)),
        gravity=jnp.array([0.0, ROBOT.gravity[2]]),
        base_pose=jnp.array([np.pi / 2, 0, 0]),
        actuators=ThreadlikeActuator.tendons(routing),
        backend="jax",
    )
    before, after = (jnp.array(case.tensions(ROBOT, a)) for a in (case.START, case.END))
    rate = jax.jit(lambda y, u: robot.forward_dynamics(0.0, y, (u, jnp.zeros(n))))
    q = np.zeros(n)
    for share in (0.25, 0.5, 0.75, 1.0):  # of the tensions
        u = share * before
        found = root(
            lambda q, u=u: np.asarray(rate(jnp.array([*q, *(0 * q)]), u)[n:]), q, tol=1e-10
        )
        q = found.x
    start = jnp.array([*q, *(0 * q)])
    times = case.PERIOD * jnp.arange(1, round(DURATION / case.PERIOD) + 1)

    @jax.jit
    def run(tolerance: float) -> Any:
        motion = robot.rollout_to(
            SystemState(t=0.0, y=start),
            u=after,
            t1=DURATION,
            solver_dt=1e-4,
            save_ts=times,
            solver=getattr(diffrax, integrator)(),
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
            max_steps=1_000_000,
        )
        return jax.vmap(lambda y: robot.forward_kinematics(y[:n], ROBOT.length)[1:])(motion.y)

    return lambda tolerance: np.asarray(run(tolerance))
