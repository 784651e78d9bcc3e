"""The witness of the fault matrix notices robots that misbehave."""

import pytest
from support.hardware_boards import PASS, Bench, Board
from support.motor_bench import MotorBench, motor_file
from support.output_witness import WatchedCore

from softrobot_env.hardware.robot_file import virtual_file

ROBOT = virtual_file()
FAR = (25e-3, -10e-3, 0.0)
PERIOD = 0.02  # s


class Lying(WatchedCore):
    """A device that does something else than its program.

    Attributes:
        lie: Makes its outputs out of the program's, None for an honest one.
    """

    lie = None

    @property
    def outputs(self):
        out = super().outputs
        return out if self.lie is None else self.lie(out)


@pytest.fixture
def bench():
    """Running, on the way to `FAR`."""
    bench = Bench(ROBOT, Board(core=Lying())).start()
    bench.command(FAR, PERIOD)
    return bench


def at(out, applied):
    """Outputs with power at another place."""
    config = ROBOT.to_message()
    pairs = zip(config.center_us, config.gain, applied, strict=True)
    pulses = tuple(round(center + gain * length / 1e4) for center, gain, length in pairs)
    return out._replace(powered=True, applied=applied, pulse_us=pulses)


def shifted(steps):
    return lambda out: at(out, (out.applied[0] + steps, *out.applied[1:]))


@pytest.mark.parametrize(
    ("lie", "complaint"),
    [
        (shifted(100), "tendon 0 went"),
        (shifted(-100), "tendon 0 went"),
        (shifted(4000), "outside the limits"),
        (lambda out: out._replace(pulse_us=(1500, 1500, 1500)), "wrong pulses"),
        (lambda out: out._replace(powered=False), "pulses without power"),
    ],
    ids=["too fast", "wrong way", "outside", "wrong pulses", "no power"],
)
def test_one_bad_pass_is_noticed(bench, lie, complaint):
    bench.board.core.lie = lie
    with pytest.raises(AssertionError, match=complaint):
        bench.run(PASS)


def test_power_without_a_set_point_is_noticed(bench):
    bench.say(bench.session.stop(), 0.5)
    bench.board.core.lie = lambda out: at(out, (0, 0, 0))
    with pytest.raises(AssertionError, match="power without a set-point"):
        bench.run(PASS)


def test_a_robot_that_does_not_stop_is_noticed(bench):
    (first, *others), begin = bench.board.core.outputs.applied, bench.now

    def go_on(out):
        return at(out, (first + 2 * round((bench.now - begin) / PASS), *others))

    bench.board.core.lie = go_on
    with pytest.raises(AssertionError, match="tendon 0 went 2 of -"):
        bench.run(2 * ROBOT.watchdog)
    assert bench.now - begin == pytest.approx(ROBOT.watchdog - PERIOD, abs=2 * PASS)


def test_a_robot_that_stays_where_it_is_does_no_wrong(bench):
    stays = bench.board.core.outputs.applied
    bench.board.core.lie = lambda out: at(out, stays)
    bench.run(0.3)


# ---------------------------------------------------------------- of motors


@pytest.fixture
def motors():
    """Moved by a host that is quiet from now on."""
    pytest.importorskip("dynamixel_sdk", reason="needs the robot extra")
    bench = MotorBench(motor_file("dynamixel")).start()
    bench.go(0.01, 0.4)
    bench.run_for(0.3)
    assert bench.witness.unsafe == []
    return bench


@pytest.mark.parametrize(
    ("step", "complaint"),
    [(6e-5, "moved at"), (1.5e-4, "too fast"), (0.011, "out of range")],
    ids=["moves", "too fast", "outside"],
)
def test_a_motor_that_does_what_it_must_not_is_noticed(motors, step, complaint):
    motors.device.motors[1].length += step
    motors.run_for(2 * PASS)
    assert any(complaint in text for text in motors.witness.unsafe)
