"""Which timesteps are safe for the rig: elastic tendons, pretension, slack and friction.

The map is over the timestep and the stiffness of the tendons, from a hundredth of nylon's to that
of steel. Servos that hold the ends of stiff tendons bring stiffness without damping, and tendons
cannot push nor pull beyond their limit, so a run may be unstable without ever growing: its tensions
jump between zero and the limit. Hence tensions are judged besides the tip. Stiff tendons that
tighten on an undamped rig strike like hammers: then small errors grow to any size within a second,
refined runs differ, and all that can be said of a run is whether it ended.
"""

from collections.abc import Iterator
from itertools import product

from softrobot_env.benchmarks.jobs import Job
from softrobot_env.benchmarks.stability.rig.cases import Variation
from softrobot_env.benchmarks.stability.rig.runs import JOINTS, RigRow, reference, run
from softrobot_env.benchmarks.stability.runs import CHAIN_INTEGRATORS, rule_choice

MAP, RULE, ASKED = "rig_map", "rig_rule", "rig_rule_asked"
CASES = (MAP, RULE, ASKED)

TIMESTEPS = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)
TENDONS = (1e-2, 1e-1, 1.0, 1e1, 1e2, 1e3, 1e4)
DAMPINGS = (0.0, 0.1, 1.0)

#: A quick run.
QUICK_TIMESTEPS, QUICK_TENDONS, QUICK_DAMPINGS = (1e-3, 5e-3, 2e-2), (1.0, 1e4), (0.0, 1.0)


def jobs(quick: bool = False) -> Iterator[Job]:
    """The map with what the timestep rule picks on it, and the rule for all kinds of rigs."""
    tendons, dampings = (QUICK_TENDONS, QUICK_DAMPINGS) if quick else (TENDONS, DAMPINGS)
    steps = QUICK_TIMESTEPS if quick else TIMESTEPS
    for damping in dampings:
        for tendon in tendons:
            rig = Variation(tendon_stiffness=tendon, damping=damping)
            name = f"rig, tendons x {tendon:g}, damping x {damping:g}"
            yield name, lambda r=rig: variation_rows(r, steps)
    for rig in () if quick else variations():
        yield "rig, timestep rule", lambda r=rig: variation_rows(r, ())


def variations() -> Iterator[Variation]:
    """Rigs beyond the map that the rule has to keep stable."""
    for tendon, modulus, damping in product((1e-2, 1.0, 1e2, 1e4), (0.5, 10.0, 100.0), (0, 1, 10)):
        yield Variation(tendon, modulus, damping)
    for tendon, damping in product((1.0, 1e2, 1e4), (0.0, 1.0)):
        for drive in product((0.0, 0.5, 10.0), (0.0, 0.3), ("bend", "slack")):
            rig = Variation(tendon, 1.0, damping, *drive)
            if rig != Variation(tendon, damping=damping):  # on the map
                yield rig


def variation_rows(rig: Variation, timesteps: tuple[float, ...]) -> list[RigRow]:
    """Runs of a rig with given timesteps and every integrator, and with the rule's choices."""
    system = rig.system(JOINTS)
    truth = reference(rig, system)
    rows = [
        run(rig, system, truth, integrator, timestep, MAP)
        for integrator in CHAIN_INTEGRATORS
        for timestep in timesteps
    ]
    for asked in (None, *CHAIN_INTEGRATORS):
        choice = rule_choice(system, asked, rig.friction > 0)
        case = RULE if asked is None else ASKED
        rows.append(run(rig, system, truth, choice.integrator, choice.timestep, case))
    return rows
