"""`softrobot optimise`: actions by which the tip follows a path, from derivatives of the motion."""

from argparse import Namespace
from contextlib import closing
from time import process_time
from typing import Any

from numpy import ndarray

from softrobot_env.core.artifacts import write_arrays
from softrobot_env.core.interfaces import Observation
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.rendering.plots import plot_task
from softrobot_env.rendering.tables import named_values

from .arguments import positive, scene_options, whole
from .cases import make_setup, one_task
from .output import filling, progress_on, say, write_report

EXAMPLE = """softrobot optimise --task swing
  softrobot optimise --robot my.toml --task circle --out out/circle"""


ARGUMENTS = """
    <robot> default: the task's
    <task>
    --roughness R (1e-5)  cost of the square of an action's change in a period, over that of an
        error of the robot's length
    --steps N (40)  of the search, at most
    --out DIR (out/optimise)
    <overwrite>
    <no-plots>
    <scene>
"""

KINDS = {"roughness": positive, "steps": whole}


class _Played:
    """A policy of known actions."""

    requires = ()

    def __init__(self, actions: ndarray) -> None:
        self._actions = actions

    def predict(
        self,
        observation: Observation,
        state: int | None = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[ndarray, int]:
        """The next action."""
        count = state or 0
        return self._actions[count], count + 1


@filling
def run(args: Namespace) -> int:
    """Run the command; 1 if the episode with the actions fails."""
    from softrobot_env.gradients import Rollout  # takes time to load
    from softrobot_env.gradients.tracking import follow

    task, begin = one_task(args, make_setup(args).robot), process_time()
    with closing(TrackingEnv(task, **scene_options(args))) as env:
        title = f"{task.name} of {env.task.robot.name}"
        with progress_on(title, args.steps) as show:

            def shown(step: int, error: float) -> None:
                show(f"{title}, {1e3 * error:.3g} mm off", step, args.steps)

            limits = {"roughness": args.roughness, "most_steps": args.steps}
            found = follow(Rollout.of(env), show=shown, **limits)
        seconds = process_time() - begin
        actions = found.inputs.astype(env.action_space.dtype)
        played = run_episode(env, _Played(actions))
    table = {"time": played.time[:-1], "action": actions}
    write_arrays(args.out / "actions.npz", table)
    error = played.error
    row = {
        "task": task.name,
        "robot": env.task.robot.name,
        "e_max": float(error.max()),
        "e_mean": float(error.mean()),
        "e_final": float(error[-1]),
        "steps": found.steps,
        "seconds": seconds,
        "failure": played.failure,
    }
    said = {
        "largest error": f"{1e3 * row['e_max']:.3g} mm, mean {1e3 * row['e_mean']:.3g}, "
        f"at the end {1e3 * row['e_final']:.3g}",
        "search": f"{found.steps} steps, {seconds:.1f} s of the processor",
    }
    if played.failure is not None:
        said["failure"] = played.failure

    def draw() -> None:
        plot_task({"optimised": played}, task, title, args.out, task.name)

    results = named_values(title, said)
    say(results)
    write_report(args, [row], title, results, draw, files=["actions.npz"])
    return int(played.failure is not None)
