"""From the recording of a twin to all parameters that controllers know of it."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from softrobot_env.control.rig.identified import IdentifiedParameters, turned
from softrobot_env.control.rig.inverse import TOTAL
from softrobot_env.identification.backlash import backlash_of, visit_sides
from softrobot_env.identification.decay import damping_of, visit_decays
from softrobot_env.identification.networks import (
    HIDDEN,
    TRAINING,
    VALIDATION,
    direction_of,
    rms,
)
from softrobot_env.identification.stiffness import calibrate
from softrobot_env.identification.visits import (
    RigData,
    collect,
    disk_points,
    measure,
    split,
)
from softrobot_env.interfaces import Show
from softrobot_env.learned.early_stopping import train
from softrobot_env.learned.network import Network
from softrobot_env.robots import RIG
from softrobot_env.robots.twin import Twin

#: Points of a visit: those to train and to watch, and as many to test as to watch (sec. 5.1.1).
NEEDED = 215

#: Points measured between two reports of the progress.
_PORTION = 20


@dataclass(frozen=True)
class Recording:
    """What was measured of a rig.

    Attributes:
        data: Of the points all over the workspace.
        sides: (3 k, 2, 2) [m], see `backlash.visit_sides`.
        decays: (k, n, 2) [m], see `decay.visit_decays`.
        twin: Seed of the twin, None if it has none.
    """

    data: RigData
    sides: np.ndarray
    decays: np.ndarray
    twin: int | None = None


@dataclass(frozen=True)
class Identification:
    """What a recording tells.

    Attributes:
        parameters: For the controllers.
        forward: s -> z.
        errors: rms on the test set by direction, "forward" and "inverse", [m].
    """

    parameters: IdentifiedParameters
    forward: Network
    errors: dict[str, float]


def record(
    twin: Twin | int | None, seed: int = 0, count: int = NEEDED, show: Show | None = None
) -> Recording:
    """Measure a twin all over its workspace, its backlash and its decay.

    With a constant sum of tensions. Networks of these data err by half as much as with the least
    tensions, whose kinks they round off: 0.14 instead of 0.25 mm in the lengths, without dither
    (twin 0, 926 points, 5 trainings).

    Args:
        twin: See `RigEnv`.
        seed: Of order and noise.
        count: Number of points, 926 in the thesis.
        show: Told how far it is, or None.
    """

    def told(done: int) -> None:
        if show is not None and done % _PORTION == 0:
            show("visiting points", done, count)

    points = disk_points(count)
    measured = partial(measure, twin, seed=seed, progress=told)
    data = collect(RIG, measured, np.random.default_rng(seed), points, TOTAL)
    number = twin.seed if isinstance(twin, Twin) else twin
    return Recording(data, visit_sides(twin, seed), visit_decays(twin, seed), number)


def identify(recording: Recording, seed: int = 0) -> Identification:
    """Train both networks with 150 samples, calibrate the model, tell damping and backlash.

    Args:
        recording: See `record`; 215 points or more.
        seed: Of split and initial parameters.

    Raises:
        ValueError: Too few points.
    """
    data = recording.data
    if len(data.lengths) < NEEDED:
        raise ValueError(f"need {NEEDED} points or more, got {len(data.lengths)}")
    rng = np.random.default_rng(seed)
    parts = split(len(data.lengths), rng)
    known = parts.training[:TRAINING]  # as many as the thesis has, and as many to watch with
    watched = parts.validation[:VALIDATION]
    networks, errors = {}, {}
    for name in ("forward", "inverse"):
        every = direction_of(data, name)
        training = every.take(known)
        network = train(training.new_network(HIDDEN, rng), training, every.take(watched)).network
        test = every.take(parts.test)
        networks[name], errors[name] = network, rms(network, test)
    stiffness, turn = calibrate(RIG, data.lengths[known], data.measured[known])
    backlash = backlash_of(recording.sides, networks["inverse"])
    damping, _ = damping_of(recording.decays, turned(RIG, stiffness, turn, 1.0))
    found = IdentifiedParameters(
        networks["inverse"], stiffness, turn, damping, backlash, recording.twin
    )
    return Identification(found, networks["forward"], errors)
