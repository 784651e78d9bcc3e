"""Stepping a scene without ever hiding a diverged state."""

from dataclasses import replace

import mujoco
import numpy as np
from mujoco import mj_step, mj_step1, mj_step2

from softrobot_env.scene.build import Scene

_DIVERGED = {
    int(mujoco.mjtWarning.mjWARN_BADQPOS): "position",
    int(mujoco.mjtWarning.mjWARN_BADQVEL): "velocity",
    int(mujoco.mjtWarning.mjWARN_BADQACC): "acceleration",
}
_HEALTHY = bytes(4 * int(mujoco.mjtWarning.mjNWARNING))


class Simulation:
    """A scene's model and data, advanced one control period at a time.

    MuJoCo evaluates kinematics and sensors at the start of a step, so after `mj_step` they lag
    the state by one timestep. Here the last half step of a period is done at its end and the
    rest of it at the start of the next one: the same work, and all read-outs are current.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.model = scene.model
        self.data = mujoco.MjData(scene.model)
        self._substeps = scene.timestep.substeps
        # mj_step1/2 do not split a Runge-Kutta step.
        self._splits = scene.timestep.integrator != "RK4"
        self._warnings = self.data.warning.number

    def __getstate__(self) -> dict:
        # The view into MjData has to be taken anew in the copy.
        return {k: v for k, v in self.__dict__.items() if k != "_warnings"}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self.model = self.data.model
        self.scene = replace(self.scene, model=self.model)
        self._warnings = self.data.warning.number
        if self.scene.timestep.integrator == "discrete":
            # A pickle leaves out what the first half of a step prepares for the second.
            mujoco.mj_fwdPosition(self.model, self.data)
            mujoco.mj_fwdVelocity(self.model, self.data)

    @property
    def ctrl(self) -> np.ndarray:
        """(nu,) controls in force, to be written to."""
        return self.data.ctrl

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self.data.time

    @property
    def posture(self) -> np.ndarray:
        """Hinge angles (nq,) [rad]."""
        return self.data.qpos.copy()

    def reset(self, qpos: np.ndarray, ctrl: np.ndarray) -> None:
        """Set a posture (nq,) [rad] at rest, with controls (nu,) in force."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = qpos
        self.data.ctrl[:] = ctrl
        mujoco.mj_forward(self.model, self.data)

    def advance(self) -> bool:
        """Integrate over one control period with the controls in `data.ctrl`.

        Returns:
            Whether all went well; if not, `failure` says what happened.
        """
        model, data, substeps = self.model, self.data, self._substeps
        if self._splits:
            mj_step2(model, data)
            substeps -= 1
        if substeps:
            mj_step(model, data, substeps)
        mj_step1(model, data)
        return self._warnings.tobytes() == _HEALTHY

    def advance_through(self, controls: np.ndarray) -> bool:
        """Integrate over one control period with controls (k, nu), one row per timestep.

        At most one row more than the period has timesteps. The last row holds for the rest of the
        period, and is in force at its end. Rows at the timesteps' starts are the most accurate for
        controls that change steadily: they come half a step late, which makes up for the half step
        by which the integrator lets forces act early.

        Returns:
            Whether all went well; if not, `failure` says what happened.
        """
        model, data, ctrl = self.model, self.data, self.data.ctrl
        for index, row in enumerate(controls[:-1]):
            ctrl[:] = row
            if index == 0 and self._splits:
                mj_step2(model, data)
            else:
                mj_step(model, data)
        ctrl[:] = controls[-1]
        taken = len(controls) - 1
        if not taken:
            return self.advance()
        if self._substeps > taken:
            mj_step(model, data, self._substeps - taken)
        mj_step1(model, data)
        return self._warnings.tobytes() == _HEALTHY

    @property
    def step_times(self) -> np.ndarray:
        """Times [s] of the ends of a control period's timesteps, since its start."""
        return self.model.opt.timestep * np.arange(1, self._substeps + 1)

    def failure(self) -> str | None:
        """What diverged and when, or None. MuJoCo's own reset is switched off in our scenes."""
        if self._warnings.tobytes() == _HEALTHY:
            return None
        raised = {name: self.data.warning[i] for i, name in _DIVERGED.items()}
        raised = {name: warning for name, warning in raised.items() if warning.number}
        if not raised:
            return None
        kinds = ", ".join(f"{name} of DOF {w.lastinfo}" for name, w in raised.items())
        return (
            f"simulation diverged in the control period ending at t = {self.data.time:.3f} s: not "
            f"finite or huge are {kinds} ({self.scene.timestep.integrator}, timestep "
            f"{self.model.opt.timestep:g} s)"
        )
