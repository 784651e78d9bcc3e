"""What is passed to the compiled integration: its places, and arrays for its work."""

from collections import namedtuple

#: Places of a robot's sizes and shared arrays in `header` (int64).
NQ, NV, NU, NBODY, NTENDON, MEMORY, STRIDE, LENGTHS = range(8)
PATH, ROWS, SERVOS, TOLD, TELL, SHADOW_STATES, OFFSETS = range(8, 15)

#: Arrays whose offsets in MuJoCo's structures follow in the header, from `OFFSETS` on.
MODEL_FIELDS = (
    "M_rownnz", "M_rowadr", "M_colind", "jnt_stiffness", "dof_jntid", "dof_damping",
    "actuator_biasprm", "actuator_forcerange", "ten_J_rownnz", "ten_J_rowadr", "ten_J_colind",
    "tendon_frictionloss", "actuator_gainprm", "dof_parentid",
)  # fmt: skip
DATA_FIELDS = (
    "qpos", "qvel", "ctrl", "qfrc_applied", "xfrc_applied", "qacc", "M", "qfrc_passive",
    "qfrc_bias", "qfrc_actuator", "actuator_moment", "moment_rownnz", "moment_rowadr",
    "moment_colind", "actuator_force", "cdof", "qfrc_smooth", "ten_J",
    "actuator_length",
)  # fmt: skip
HEADER = OFFSETS + len(MODEL_FIELDS) + len(DATA_FIELDS) + 1  # and the time

#: Places in the header of the offsets, by the names of the fields.
AT = namedtuple("AT", (*MODEL_FIELDS, *DATA_FIELDS, "time"))(*range(OFFSETS, HEADER))

#: Places in a simulation's `memory` (float64): settings, then what it remembers and tells.
METHOD, SUBSTEPS, PERIOD, LONGEST, SHORTEST, ACCURACY, RATE, FEWEST, MOST = range(9)
NEXT, WORST, MISSED, EVALUATIONS, STEPS, SUM, ESTIMATE = range(9, 16)
MEMORY_SIZE = 16  # of a simulation; its shadow's, alike, follows

#: Rows (nu,) of what is known of a simulation's servos: settings, order, and where they are.
SPEED, OFFSET, HALF, COMMAND, MOTOR, HORN = range(6)
SERVO_ROWS = 6

#: Values of METHOD: ours, MuJoCo's in two halves, MuJoCo's Runge-Kutta.
EXTRAPOLATED, SPLIT, WHOLE = range(3)

#: Largest magnitude of a position or velocity that has not diverged, as MuJoCo has it.
HUGE = 1e10
