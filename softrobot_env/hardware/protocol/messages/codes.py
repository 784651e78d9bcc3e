"""Numbers that stand for something in messages; every enumeration enters the tables' hash."""

from enum import IntEnum, IntFlag


class DeviceState(IntEnum):
    """What the microcontroller is doing."""

    DISARMED = 0  # outputs off
    ARMED = 1  # outputs off, waiting for a first set-point near the present position
    RUNNING = 2  # outputs follow set-points
    RAMPING = 3  # outputs go to the rest position with a limited speed, and then off
    LATCHED = 4  # outputs off; a fault waits to be cleared


class Fault(IntEnum):
    """Why a microcontroller stopped by itself; `State.faults` has bit 1 << fault."""

    NONE = 0
    WATCHDOG = 1  # no fresh set-point in time
    ESTOP = 2  # emergency stop, by message or by a switch
    FORCE = 3  # a tendon pulls more than allowed
    SLACK = 4  # a tendon is loose
    STALL = 5  # a servo is not where it was driven
    ADC = 6  # a converter's channel is at a rail
    BROWN_OUT = 7  # supply voltage too low


class Warning(IntFlag):
    """Bits of `State.warnings`."""

    SLEWING = 1  # outputs are still on their way to the set-point
    ADC_RAIL = 2  # a supervised channel of the converter is at a rail
    LATE_SETPOINT = 4  # a set-point was older than its time to live
    OLD_SEQUENCE = 8  # a set-point came twice or out of order


class Reset(IntEnum):
    """Why the microcontroller started."""

    POWER_ON = 0
    EXTERNAL = 1
    BROWN_OUT = 2
    WATCHDOG = 3


class Capability(IntFlag):
    """What a board has beyond outputs."""

    LENGTH = 1  # measures the position of its servos
    FORCE = 2  # measures tendon forces
    ADC = 4
    SUPPLY = 8  # measures its supply voltage
    ESTOP_SWITCH = 16


class Reason(IntEnum):
    """Why a message was refused."""

    STATE = 1  # not in this state
    SESSION = 2
    CONFIG = 3  # not configured, or with another configuration
    COUNT = 4  # number of tendons
    RANGE = 5  # a value outside the configured range
    FAR = 6  # first set-point too far from the present position
    FAULT = 7  # clears another fault than the latched one, or its cause is still there
    PROTOCOL = 8
    LATE = 9  # older than its time to live
    SEQUENCE = 10  # not newer than the last one
    MODE = 11


#: Set-points are lengths pulled in. The only mode of protocol 1.
MODE_LENGTH = 0

#: Every enumeration of this module, and every set of bits.
ENUMERATIONS = (DeviceState, Fault, Reset, Reason)
FLAGS = (Capability, Warning)
