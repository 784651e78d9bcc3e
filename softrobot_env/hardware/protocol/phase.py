"""How far a host has come with a robot."""

from enum import IntEnum

from softrobot_env.hardware.protocol.messages import DeviceState


class Phase(IntEnum):
    """From knowing nothing to running."""

    LOST = -1  # the robot has forgotten a session that was going on
    NEW = 0  # nobody has answered
    GREETED = 1
    CONFIGURED = 2
    ARMING = 3
    ARMED = 4
    RUNNING = 5
    STOPPING = 6


_FOLLOWING = {DeviceState.ARMED: Phase.ARMED, DeviceState.RUNNING: Phase.RUNNING}


def next_phase(phase: Phase, state: DeviceState, ours: bool) -> Phase:
    """Phase after a state message without faults.

    Args:
        phase: The phase before.
        state: What the robot does.
        ours: Whether it names the host's session.
    """
    if phase == Phase.STOPPING:
        over = state in (DeviceState.DISARMED, DeviceState.LATCHED)
        return Phase.CONFIGURED if over else phase
    if phase == Phase.ARMED and state == DeviceState.DISARMED:
        return Phase.CONFIGURED  # no first set-point came in time, or none was accepted
    if phase >= Phase.ARMING and ours:
        return _FOLLOWING.get(state, phase)
    return Phase.LOST if phase >= Phase.ARMED else phase
