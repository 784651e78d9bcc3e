"""How late this machine wakes processes, measured by a process of its own."""

import subprocess
import sys

#: Sleeps, works for a moment as a real-time loop does, and keeps the worst delay [s] of both. Tells
#: it when its input ends.
_WITNESS = """
import select, sys, time
worst = 0.0
print(flush=True)
while not select.select([sys.stdin], [], [], 0)[0]:
    begin, spent = time.monotonic(), time.process_time()
    time.sleep(4e-3)
    while time.process_time() - spent < 1e-3:
        pass
    worst = max(worst, time.monotonic() - begin - 5e-3)
print(worst)
"""


class Machine:
    """Watches the machine from entering the context on."""

    def __enter__(self):
        command = [sys.executable, "-I", "-S", "-c", _WITNESS]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._process.stdout.readline()  # it watches
        return self

    def worst(self) -> float:
        """Longest delay [s] until now; ends the watch."""
        return float(self._process.communicate()[0])

    def __exit__(self, *error):
        if self._process.poll() is None:
            self._process.communicate()
