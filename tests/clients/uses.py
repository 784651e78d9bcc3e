"""Short uses of a library, and what became of each: printed for `run.py`, one line each."""

import json
import sys
import traceback
from collections.abc import Callable, Iterable

from softrobot_env.core import sources
from softrobot_env.registration import ANY_ROBOT, ENVIRONMENTS, RIG_ENVIRONMENTS

SIMULATED = (*ENVIRONMENTS, *RIG_ENVIRONMENTS, *ANY_ROBOT)

#: One of each kind, for uses that take long.
SOME = ("SoftRobot/ArmStep-v0", "SoftRobot/RigReach-v0", *ANY_ROBOT)


def tried(use: str, ids: Iterable[str], act: Callable[[str], None]) -> None:
    """Use every environment of `ids`; say how many went well, and what the first failure was."""
    good, reason, ids = 0, "", tuple(ids)
    for env_id in ids:
        try:
            act(env_id)
            good += 1
        except Exception as error:
            if not reason:
                traceback.print_exc(file=sys.stderr)
                reason = " ".join(f"{env_id}: {type(error).__name__}: {error}".split())[:200]
    row = {"use": use, "good": good, "tried": len(ids), "reason": reason}
    print("USE " + json.dumps({"row": row, "sources": sources.recorded()}))
    sys.stdout.flush()
