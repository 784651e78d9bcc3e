"""Random robot files that say no `pieces`: sections, tapers, routes, drives, what they carry.

File `index` of a seed is always the same. Tensions are drawn in units of what bends the robot.
"""

from math import cos, pi, radians, sin, sqrt
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from softrobot_env.core.files import text
from softrobot_env.robots import RobotParams
from softrobot_env.robots.file import read_robot
from studies.scenes_drawn import G

Table = dict[str, Any]


def draw_file(seed: int, index: int) -> str:
    """Text of the random robot file of a seed and an index, both zero or more."""
    rng = np.random.default_rng([seed, index])
    sections = _sections(rng)
    ends = np.cumsum([one["length_m"] for one in sections]).tolist()
    table: Table = {"name": f"random_{seed}_{index}"}
    if rng.random() < 0.7:
        table["gravity_m_s2"] = [0.0, 0.0, -G]
    table["base"] = {"direction": _direction(rng), "roll_rad": float(rng.uniform(-pi, pi))}
    table["section"] = sections
    table["tendon"] = _tendons(rng, sections, ends)
    if rng.random() < 0.3:
        table["disc"] = [_disc(rng, sections[-1], ends[-1] * share) for share in (0.5, 1.0)]
    return text(table)


def drawn_robot(seed: int, index: int) -> RobotParams:
    """The robot of the file, as it is read.

    Raises:
        ValueError: The file says what is not allowed.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "robot.toml"
        path.write_text(draw_file(seed, index), encoding="utf-8")
        return read_robot(path)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between two positive ones, all orders of magnitude alike."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _sections(rng: np.random.Generator) -> list[Table]:
    """One to three sections, a half of them tapered, that can carry themselves."""
    count = int(rng.integers(1, 4))
    length = _log(rng, 0.05, 1.0) / count
    radius = count * length / _log(rng, 8, 80) / 2
    modulus, out = _log(rng, 2e5, 1e9), []
    weight = 1100.0 * G * (count * length) ** 3 * 4 / radius**2  # rho A g L^3 / EI = weight / E
    modulus = max(modulus, weight / _log(rng, 0.1, 8))
    for _ in range(count):
        tip = radius * (rng.uniform(0.2, 1.0) if rng.random() < 0.5 else 1.0)
        one = {"length_m": length * rng.uniform(0.6, 1.4), "outer_radius_m": [radius, tip]}
        if rng.random() < 0.2:
            share = rng.uniform(0.2, 0.8)
            one["inner_radius_m"] = [share * radius, share * tip]
        one |= {"youngs_modulus_Pa": modulus, "density_kg_m3": 1100.0, "damping_time_s": 0.02}
        out.append(one | {"poisson_ratio": rng.uniform(0.0, 0.5)})
        radius = tip * rng.uniform(0.8, 1.0)
    return out


def _direction(rng: np.random.Generator) -> list[float]:
    """Hanging, standing, sideways or anyhow."""
    anyhow = rng.standard_normal(3)
    named = ([0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], (anyhow / 2).tolist())
    return named[rng.choice(4, p=(0.4, 0.15, 0.2, 0.25))]


def _tendons(rng: np.random.Generator, sections: list[Table], ends: list[float]) -> list[Table]:
    """A table for some sections, always for the last: one tendon, a pair, or three around."""
    length_driven, guided = rng.random() < 0.3, rng.random() < 0.3
    out = []
    for k, section in enumerate(sections):
        if k < len(sections) - 1 and rng.random() < 0.5:
            continue
        count = int(rng.integers(1, 4))
        thinnest = min(min(one["outer_radius_m"]) for one in sections[: k + 1])
        distance, end = thinnest * rng.uniform(0.3, 1.5), ends[k]
        softest = pi / 4 * thinnest**4 * section["youngs_modulus_Pa"]
        stiffest = pi / 4 * section["outer_radius_m"][0] ** 4 * section["youngs_modulus_Pa"]
        bend = _log(rng, 0.3, 6.0) * sqrt(softest * stiffest) / end
        one: Table = {
            "name": [f"t{k}{n}" for n in range(count)],
            "tension_limit_N": bend / distance,
        }
        one |= _route(rng, distance, end, guided)
        if guided:
            one["guides_m"] = np.linspace(0, end, int(rng.integers(3, 9)))[1:-1].tolist()
        if length_driven:
            one |= {"drive": "length", "stiffness_N_m": bend / distance**2 * _log(rng, 0.3, 30)}
        out.append(one)
    return out


def _route(rng: np.random.Generator, distance: float, end: float, guided: bool) -> Table:
    """Where a tendon runs: straight, wound, or towards the fibre and about it."""
    kind, angle = rng.choice(("straight", "helix", "via"), p=(0.5, 0.3, 0.2)), rng.uniform(0, 360)
    if kind == "via" and not guided:
        at, share = rng.uniform(0.3, 0.7) * end, rng.uniform(0.3, 1.0)
        turns = (radians(angle) + x for x in (0.0, rng.uniform(0, 1), rng.uniform(0, 2)))
        sizes = zip((0.0, at, end), (1.0, share, share * share), turns, strict=True)
        return {"route_m": [[s, distance * r * cos(a), distance * r * sin(a)] for s, r, a in sizes]}
    found = {"radius_m": distance, "angle_deg": angle, "end_m": end}
    return found if kind == "straight" else found | {"helix_turns": rng.uniform(-1.5, 1.5)}


def _disc(rng: np.random.Generator, section: Table, station: float) -> Table:
    radius = section["outer_radius_m"][0] * rng.uniform(1.2, 2.0)
    mass = 1100.0 * pi * radius**2 * 0.1 * section["length_m"] * rng.uniform(0.1, 1.0)
    size = {"radius_m": radius, "thickness_m": 0.02 * section["length_m"]}
    return {"station_m": station, "mass_kg": mass} | size
