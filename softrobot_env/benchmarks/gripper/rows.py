"""The rows of the gripper study."""

from dataclasses import dataclass

from softrobot_env.benchmarks.records import Record, drawn


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
        pieces: Of the fingers that grip; those of the examples have as many as told beside.
        fitted: Pieces of the fingers of the examples; None where nothing is fitted.
        noise: [deg], of each sensor's angle.
        count: Number of bars.
        mean, high, most: [m], mean, 95th percentile and largest size of the errors.
        diameters, errors: (count,) [m].
    """

    method: str
    pieces: int
    fitted: int | None
    noise: float
    count: int
    mean: float
    high: float
    most: float
    diameters: tuple[float, ...] = drawn()
    errors: tuple[float, ...] = drawn()


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
        rule: Whether it is the rule's timestep with as many pieces.
        count: Grippers at once.
        threads: That share the work.
        steps_per_s: Of all together.
        bend_error: [deg], largest difference of a sensor's angle at the end of a closing from that
            with the rule's pieces and timestep; None of many at once.
    """

    task: str
    pieces: int
    timestep: float
    rule: bool
    count: int
    threads: int
    steps_per_s: float
    bend_error: float | None
