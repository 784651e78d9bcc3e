"""The rows of the gripper study."""

from dataclasses import dataclass

from softrobot_env.benchmarks.records import Record, for_pictures


@dataclass(frozen=True)
class Grip(Record):
    """A clamped object under a tension that rises slowly.

    Attributes:
        thing: What is gripped.
        tension: [N].
        kind: "open", "enclosing" or "fingertip".
        angles: (sensors,) [deg], bends of the middle finger's sensors.
        touching: Share [1] of the links of the middle finger that press on it.
        tip_share: Share [1] in the last tenth of that finger of the forces beyond its first 40 %.
        turn: [deg], of a sensor that lies on a cylinder altogether; None of others.
    """

    thing: str
    tension: float
    kind: str
    angles: tuple[float, ...]
    touching: float
    tip_share: float
    turn: float | None


@dataclass(frozen=True)
class Size(Record):
    """Errors of estimated diameters of bars that were not used to fit, from one enclosing grip.

    Attributes:
        method: How they are estimated.
        task: "enclose" of clamped bars, "hold" of free ones.
        pieces: Of the fingers that grip; those of the examples have as many as told beside.
        fitted: Pieces of the fingers of the examples; None where nothing is fitted.
        errors: Imperfections of the fingers' sensors, over the usual ones; None of exact bends.
        count: Number of bars.
        mean, high, most: [m], mean, 95th percentile and largest size of the errors.
        diameters, off: (count,) [m], and their errors.
    """

    method: str
    task: str
    pieces: int
    fitted: int | None
    errors: float | None
    count: int
    mean: float
    high: float
    most: float
    diameters: tuple[float, ...] = for_pictures()
    off: tuple[float, ...] = for_pictures()


@dataclass(frozen=True)
class Shape(Record):
    """How far calibrated sensors err in the same grips, and the shape of three arcs they tell.

    Attributes:
        task: As there.
        pieces: Of the fingers.
        errors: Imperfections of the sensors, over the usual ones; None of exact mean bends.
        count: Number of fingers.
        bend, high_bend, most_bend: [deg], mean, 95th percentile and largest error of a sensor.
        tip, high_tip, most_tip: [m], the same of the tip.
    """

    task: str
    pieces: int
    errors: float | None
    count: int
    bend: float
    high_bend: float
    most_bend: float
    tip: float
    high_tip: float
    most_tip: float


@dataclass(frozen=True)
class Outcome(Record):
    """Episodes of a task with random bars and fingers, and pulls and shaking where bars are held.

    Attributes:
        task: Its name.
        policy: Its name.
        pieces: Of each finger.
        timestep: [s].
        count: Number of episodes.
        success: Share [1] that succeeded.
        lost: Share [1] in which the bar was lost.
        error: Median, over what counts as success [1]: of holds the largest of each episode, of
            enclosing grips the last.
        tension: [N], mean at the end.
        ms_per_step: Of one gripper.
    """

    task: str
    policy: str
    pieces: int
    timestep: float
    count: int
    success: float
    lost: float
    error: float
    tension: float
    ms_per_step: float


@dataclass(frozen=True)
class Speed(Record):
    """What a step costs with some pieces and timestep, and how far it is off.

    Attributes:
        task: Name of the task.
        pieces: Of each finger.
        timestep: [s].
        fineness: Name of the setting.
        count: Grippers at once.
        threads: That share the work.
        steps_per_s: Of all together.
        mean_error, bend_error: [deg], mean and largest difference of a sensor's angle from that
            by the rule, during closings on some bars; None of many at once.
    """

    task: str
    pieces: int
    timestep: float
    fineness: str
    count: int
    threads: int
    steps_per_s: float
    mean_error: float | None
    bend_error: float | None
