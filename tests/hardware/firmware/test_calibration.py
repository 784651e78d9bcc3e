"""Another calibration: what it says about servos that stay where they are."""

from dataclasses import replace

import numpy as np
import pytest
from support.firmware_bench import (
    AWAY,
    CONFIG,
    SESSION,
    Bench,
    is_off,
    refusals,
    running,
)

from softrobot_env.hardware.protocol import messages as m


def with_servos_that_nobody_measures():
    """Switched off away from rest."""
    bench = Bench(capabilities=m.Capability(0)).start()
    bench.hold(50, *AWAY)
    assert bench.out.pulse_us == (1525, 1385, 1603)
    bench.run(m.EStop())
    bench.run(m.Clear(m.Fault.ESTOP))
    return bench


@pytest.mark.parametrize(
    ("changes", "present"),
    [
        ({}, AWAY),
        ({"center_us": (1505, 1380, 1610)}, (200, -50, -150)),
        ({"gain": (500, 2000, -500)}, (500, -75, -50)),
        ({"center_us": (1505, 1400, 1600), "gain": (-1600, 1000, 300)}, (-125, -150, 83)),
    ],
)
def test_a_new_calibration_leaves_unmeasured_servos_where_they_are(changes, present):
    bench = with_servos_that_nobody_measures()
    before = np.array((1525, 1385, 1602.5))
    bench.arm(replace(CONFIG, **changes))
    assert bench.out.applied == present
    assert refusals(bench.run(bench.setpoint(present[0] + 101, *present[1:]))) == [m.Reason.FAR]
    assert refusals(bench.run(bench.setpoint(*present))) == []
    assert bench.out.powered
    assert np.all(abs(bench.out.pulse_us - before) <= 0.51)


def test_the_same_configuration_again_and_again_changes_no_length():
    bench = with_servos_that_nobody_measures()
    for _ in range(5):
        bench.configure()
    assert bench.out.applied == AWAY


def test_servos_out_of_reach_of_a_new_calibration_stay_off():
    bench = with_servos_that_nobody_measures()
    bench.arm(replace(CONFIG, center_us=(2000, 1400, 1000), gain=(1, -1000, 1)))
    assert bench.out.applied == (-32768, 150, 32767)
    assert refusals(bench.run(bench.setpoint(-3000, 150, 2500))) == [m.Reason.FAR]
    assert is_off(bench, m.DeviceState.ARMED)


def test_measured_servos_are_where_a_new_calibration_measures_them():
    bench = running()
    bench.run(m.Disarm(SESSION))
    bench.wait(5, state=m.DeviceState.DISARMED)
    bench.length = (400, -400, 300)
    bench.arm(replace(CONFIG, center_us=(1510, 1410, 1610)))
    assert refusals(bench.run(bench.setpoint(*bench.length))) == []
    assert bench.out.applied == bench.length
