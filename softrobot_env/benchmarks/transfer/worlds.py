"""What a policy meets: plants, other material, drawn robots, and twins."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from softrobot_env.beams.registry import PLANTS
from softrobot_env.envs.randomization import Randomization
from softrobot_env.evaluation.labels import variation_label
from softrobot_env.robots import RIG, RobotParams
from softrobot_env.robots.twin import drawn_twin

#: Groups of worlds.
PLANT, VARIED, TWIN = "plant", "varied", "twin"

#: Of the nominal robot, one at a time.
VARIATIONS = ({"youngs_modulus": 0.75}, {"youngs_modulus": 1.25})

#: All of them at once; seeds of what is drawn.
DRAWN = Randomization(youngs_modulus=(0.7, 1.4), density=(0.7, 1.4), damping_time=(0.5, 2.0))
SEEDS = (1,)


@dataclass(frozen=True)
class World:
    """Something to test a policy on.

    Attributes:
        name: For people.
        group: One of `PLANT`, `VARIED` and `TWIN`.
        case: Keywords of a `Case`.
    """

    name: str
    group: str
    case: Mapping[str, Any] = field(default_factory=dict)


def worlds(robot: RobotParams) -> list[World]:
    """All worlds of a robot, the plants first; twins are those of robots driven by length."""
    found = [World(plant, PLANT, {"plant": plant}) for plant in PLANTS]
    found += [
        World(variation_label({"variation": v}), VARIED, {"variation": v}) for v in VARIATIONS
    ]
    draws = (DRAWN.draw(np.random.default_rng(seed)) for seed in SEEDS)
    found += [World(f"drawn {k}", VARIED, {"variation": v}) for k, v in enumerate(draws)]
    if robot == RIG:
        found += [World(f"twin {seed}", TWIN, {"twin": seed}) for seed in SEEDS]
    elif robot.drive.kind == "length":
        twins = {seed: {"twin": drawn_twin(robot, seed)} for seed in SEEDS}
        found += [World(f"twin {seed}", TWIN, {"scene": twin}) for seed, twin in twins.items()]
    return found
