"""A study of somebody else: how far a load bends a finger."""

from dataclasses import dataclass

from softrobot_env.core.studies import register_study
from softrobot_env.robots import find_robot
from studies.lab import Record, Study, grid, lines, quantity, table


@dataclass(frozen=True, kw_only=True)
class Length(Record):
    """A robot, and a share of its length."""

    robot: str
    share: float
    length: float = quantity("mm", ".1f")


def measure(case):
    """The row of a case."""
    length = case["share"] * find_robot(case["robot"]).length
    return Length(robot=case["robot"], share=case["share"], length=length)


STUDY = Study(
    kinds=(Length,),
    cases=grid(robot=("planar_finger", "silicone_rod"), share=(0.5, 1.0)),
    quick={"robot": ("planar_finger",)},
    measure=measure,
    alone=True,
    tables=[table("Lengths", "robot", "share", "length")],
    plots={"{}": lines("share", "length", "robot", title="Longer is longer")},
)


def register():
    """What a package names in the entry-point group."""
    register_study("lengths", STUDY)
