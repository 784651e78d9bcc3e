"""Inputs by the keys of a terminal: no screen is needed, and none is read without its focus."""

import os
import sys
import termios
import tty
from dataclasses import dataclass
from select import select
from typing import Any

from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

#: Keys that raise and lower inputs one after the other, and one that lets all go.
UP, DOWN, RELEASE = "qwertyuiop", "asdfghjkl;", " "


@TeleoperatorConfig.register_subclass("softrobot_keys")
@dataclass(kw_only=True)
class SoftRobotKeysConfig(TeleoperatorConfig):
    """How keys act.

    Attributes:
        inputs: Number of the robot's inputs, at most 10.
        step: Share of full scale by which a key changes an input.
    """

    inputs: int = 1
    step: float = 0.05


class SoftRobotKeys(Teleoperator):
    """q and a raise and lower the first input, w and s the second, ...; space lets all go."""

    config_class = SoftRobotKeysConfig
    name = "softrobot_keys"

    def __init__(self, config: SoftRobotKeysConfig) -> None:
        super().__init__(config)
        if not 1 <= config.inputs <= len(UP):
            raise ValueError(f"inputs must be from 1 to {len(UP)}, got {config.inputs}")
        self._config, self._values = config, [0.0] * config.inputs
        self._terminal: int | None = None
        self._before: list[Any] | None = None

    @property
    def action_features(self) -> dict[str, Any]:
        """Names of inputs, as of the robot."""
        return {f"input.{i}": float for i in range(self._config.inputs)}

    @property
    def feedback_features(self) -> dict[str, Any]:
        """None."""
        return {}

    @property
    def is_connected(self) -> bool:
        """Whether keys are read."""
        return self._terminal is not None

    def connect(self, calibrate: bool = True) -> None:
        """Read keys one by one, from the terminal that this program was started in."""
        if not sys.stdin.isatty():
            raise RuntimeError("keys are read from a terminal: start this program in one")
        self._terminal = sys.stdin.fileno()
        self._before = termios.tcgetattr(self._terminal)
        tty.setcbreak(self._terminal)

    @property
    def is_calibrated(self) -> bool:
        """Keys need none."""
        return True

    def calibrate(self) -> None:
        """Nothing to do."""

    def configure(self) -> None:
        """Nothing to do."""

    def get_action(self) -> dict[str, Any]:
        """Inputs after all keys that were pressed until now."""
        if self._terminal is None:
            raise RuntimeError(f"{self} is not connected")
        while select([self._terminal], [], [], 0)[0]:
            keys = os.read(self._terminal, 64).decode(errors="ignore")
            if not keys:  # the terminal is gone
                break
            for key in keys:
                self._press(key)
        return {f"input.{i}": value for i, value in enumerate(self._values)}

    def _press(self, key: str) -> None:
        if key == RELEASE:
            self._values = [0.0] * len(self._values)
        for keys, step in ((UP, self._config.step), (DOWN, -self._config.step)):
            index = keys.find(key)
            if 0 <= index < len(self._values):
                self._values[index] = min(1.0, max(-1.0, self._values[index] + step))

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Keys feel nothing."""

    def disconnect(self) -> None:
        """Give the terminal back as it was."""
        terminal, self._terminal = self._terminal, None
        if terminal is not None:
            termios.tcsetattr(terminal, termios.TCSADRAIN, self._before)
