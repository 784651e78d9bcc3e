"""Steps of gym-softrobot's arm with twelve tendons, where it is installed, and of ours beside it.

Ours has its length, radii (with a linear taper), material and tendons' ends, and two hinge stations
less than it has elements. gym-softrobot damps velocities, ours strain rates, and its rod shears and
stretches, so the two are alike in size, not the same; errors are known of ours alone.
"""

from importlib.metadata import version
from math import cos, pi, sin
from time import process_time

import gymnasium
import numpy as np

from softrobot_env.benchmarks.peers.rows import OURS, Row
from softrobot_env.benchmarks.timing import best_of
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import RobotParams, Tendon
from softrobot_env.robots.sections import Section

PEER = "gym-softrobot"
PEER_ENV = "TendonArmReach-v0"

#: [s] of a step of theirs: 1111 timesteps of 30 µs.
PERIOD = 0.03333

#: Largest action of both, as a share: theirs ends an episode early if it pulls harder.
_SHARE, _STEPS = 0.2, 20


def robot() -> RobotParams:
    """Our arm of the same size."""
    half = {
        "length": 0.15,
        "youngs_modulus": 3e6,
        "density": 1000.0,
        "damping_time": 0.03,
        "pieces": 6,
        "poisson_ratio": 0.5,
    }
    tendons = (
        Tendon(
            f"{name}{i}",
            (0.01 * cos(i * pi / 3), 0.01 * sin(i * pi / 3)),
            end,
            group,
            55.2,
        )
        for group, (name, end) in enumerate((("long", 0.30), ("short", 0.15)))
        for i in range(6)
    )
    radii = (0.023, 0.0167), (0.0167, 0.0104)
    return RobotParams(
        "spirob",
        tendons=tuple(tendons),
        sections=tuple(Section(outer_radius=pair, **half) for pair in radii),
    )


def our_row(quick: bool) -> Row:
    """A row of ours, with the error that the environment tells."""
    env = TrackingEnv("reach", robot=robot(), control_period=PERIOD)
    seconds = _step_time(env, -_SHARE, quick)
    *_, info = env.step(np.zeros(env.action_space.shape, np.float32))
    return Row(
        "environment",
        OURS,
        version(OURS),
        "TrackingEnv, reach",
        env.simulation.scene.model.nv,
        e_max=float(info["integration_error"]),
        core_seconds=seconds / PERIOD,
        period=PERIOD,
        steps_per_second=1 / seconds,
    )


def peer_row(quick: bool) -> Row:
    """A row of gym-softrobot's."""
    import gym_softrobot  # noqa: F401 (registers its environments)

    env = gymnasium.make(PEER_ENV, disable_env_checker=True)
    seconds = _step_time(env, 0.0, quick)
    rod = env.unwrapped
    return Row(
        "environment",
        PEER,
        version(PEER),
        PEER_ENV,
        6 * rod.n_elements,
        timestep=rod.time_step,
        core_seconds=seconds / PERIOD,
        period=rod.time_step * rod.simulation_steps_per_action,
        steps_per_second=1 / seconds,
    )


def _step_time(env: gymnasium.Env, least: float, quick: bool) -> float:
    """Computing time [s] of a step under random actions, the best of some blocks of steps."""
    rng = np.random.default_rng(0)

    def block() -> None:
        env.reset(seed=0)
        for _ in range(_STEPS):
            action = rng.uniform(least, _SHARE, env.action_space.shape).astype(np.float32)
            if any(env.step(action)[2:4]):
                env.reset(seed=0)

    block()  # compiles
    return best_of(block, 3 if quick else 10, process_time)[0] / _STEPS
