"""The record of one episode, in the same form for simulation and hardware."""

from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy import ndarray

from softrobot_env.core.artifacts import read_arrays, write_arrays
from softrobot_env.envs.reference import AXES
from softrobot_env.recordings import Recording
from softrobot_env.recordings.recording import episode_recording
from softrobot_env.tasks import Task

#: Quantities for which a real robot may have no sensor.
_UNMEASURED = ("tendon_tension", "curvature")

#: Arrays (T, k) that pictures do not need.
_ARRAYS = ("action", "tendon_tension", "tendon_length", "curvature")


@dataclass(frozen=True)
class Rollout:
    """One episode sampled at its control instants; T instants, the first at time 0.

    Attributes:
        time: (T,) [s].
        reference: (T, 3) [m].
        tip: (T, 3) [m].
        action: (T, n_inputs) [1], the action applied just before each instant.
        tendon_tension: (T, n_tendons) [N], actually applied.
        tendon_length: (T, n_tendons) [m] inside the robot.
        curvature: (T, n_pieces) [1/m].
        reward: (T,) [1], zero at the first instant.
        policy_time: (d,) [s] spent in `predict`, at each of the policy's decisions. There is one
            for every successful step, unless the policy decides less often.
        policy_status: (d,) str, why the decided action, or the resulting motion, was not the
            intended one; "" if it was.
        wall_time: [s] the whole episode took, policy included.
        source: "sim" or "real".
        failure: What went wrong, or None.
    """

    time: ndarray
    reference: ndarray
    tip: ndarray
    action: ndarray
    tendon_tension: ndarray
    tendon_length: ndarray
    curvature: ndarray
    reward: ndarray
    policy_time: ndarray
    policy_status: ndarray
    wall_time: float
    source: str = "sim"
    failure: str | None = None

    @property
    def error(self) -> ndarray:
        """Distance (T,) [m] between tip and reference, (6.34)."""
        return np.linalg.norm(self.tip - self.reference, axis=1)

    def part(self, instants: slice) -> "Rollout":
        """The record at selected instants, with all decisions of the policy."""
        arrays = {k: v for k, v in vars(self).items() if isinstance(v, ndarray)}
        kept = {k: v[instants] for k, v in arrays.items() if not k.startswith("policy_")}
        return replace(self, **kept)

    def thinned(self, period: float) -> "Rollout":
        """The record at instants about `period` [s] apart."""
        apart = float(self.time[1] - self.time[0]) if len(self.time) > 1 else period
        return self.part(slice(None, None, max(1, round(period / apart))))

    def slim(self, *names: str) -> "Rollout":
        """The record for pictures: time, reference, tip and the named arrays only."""
        small = {k: v[:, :0] for k, v in vars(self).items() if k in _ARRAYS and k not in names}
        decisions = {"policy_time": self.policy_time[:0], "policy_status": self.policy_status[:0]}
        return replace(self, reward=np.zeros_like(self.reward), **small, **decisions)

    def recording(self, task: Task) -> Recording:
        """The commands and the tip of an episode on a task, to be written or replayed."""
        axes = AXES[task.axes]
        return episode_recording(
            task.robot,
            axes,
            self.time,
            self.action,
            self.tip[:, axes],
            labels=[task.name] * len(self.time),
            source=self.source,
        )

    def save(self, path: str | Path) -> None:
        """Write the record as a compressed npz file."""
        write_arrays(path, {k: v for k, v in asdict(self).items() if v is not None})

    @classmethod
    def load(cls, path: str | Path) -> "Rollout":
        """Read a record that `save` wrote.

        Raises:
            FileNotFoundError: No such file.
            ValueError: It is not a record, or not finite although nothing failed.
        """
        data = read_arrays(path)
        if "failure" not in data:  # after a divergence nothing is finite
            data.check_finite(unmeasured=_UNMEASURED)
        wanted = {field.name for field in fields(cls)}
        if not wanted - {"source", "failure"} <= data.keys() <= wanted:
            raise ValueError(f"{path} is no record of an episode: it holds {', '.join(data)}")
        data.check_shapes({"time": (None,)})
        instants = len(data["time"])
        data.check_shapes(
            {
                **dict.fromkeys(("reference", "tip"), (instants, 3)),
                **dict.fromkeys(("action", *_UNMEASURED, "tendon_length"), (instants, None)),
                "reward": (instants,),
                "policy_time": (None,),
                "wall_time": (),
            }
        )
        for name, dimensions in {"policy_status": 1, "source": 0, "failure": 0}.items():
            text = data.get(name)
            if text is None:
                continue
            if text.ndim != dimensions or (text.size and text.dtype.kind != "U"):
                raise ValueError(f"{path}: the array {name!r} must hold text")
        return cls(**{k: v.item() if v.ndim == 0 else v for k, v in data.items()})
