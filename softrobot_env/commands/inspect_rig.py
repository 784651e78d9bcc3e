"""What `softrobot inspect` tells of the spatial test rig alone."""

from softrobot_env.envs.rig import RigEnv
from softrobot_env.robots import RobotParams
from softrobot_env.robots.twin import Twin


def errors_left_out(twin: Twin) -> list[str]:
    """Errors that a twin can have and this one has not, and what no rig's scene has."""
    errors = {
        "servo offsets": any(twin.servo_offset),
        "backlash": any(twin.backlash),
        "tendon friction": any(tendon.friction for tendon in twin.robot.tendons),
        "precurvature": any(twin.robot.precurvature),
        "uneven stiffness": twin.robot.anisotropy > 0,
        "camera noise": twin.camera_noise > 0,
        "camera delay": twin.camera_delay > 0,
        "torsion": False,
    }
    return [name for name, there in errors.items() if not there]


def rig_rows(env: RigEnv) -> dict[str, str]:
    """Rig, servos, camera and action."""
    twin = env.twin
    return {
        "rig": "ideal" if twin.seed is None else f"twin {twin.seed}",
        "bending stiffness": _stiffness(twin.robot, env.task.robot),
        "servos": f"{1e3 * twin.servo_speed:.0f} mm/s, offsets {_millimetres(twin.servo_offset)}, "
        f"backlash {_millimetres(twin.backlash)}",
        "camera": f"noise {1e3 * twin.camera_noise:g} mm, delay {1e3 * twin.camera_delay:.3g} ms",
        "action": f"{env.action_space.shape[0]} lengths to pull in, full scale "
        f"{1e3 * env.length_scale:g} mm",
    }


def _stiffness(robot: RobotParams, nominal: RobotParams) -> str:
    share = robot.bending_stiffness / nominal.bending_stiffness
    return f"{1e3 * robot.bending_stiffness:.3g} mN m2, {share:.3f} of what policies are told"


def _millimetres(lengths: tuple[float, ...]) -> str:
    return f"({', '.join(f'{1e3 * length:.3g}' for length in lengths)}) mm"
