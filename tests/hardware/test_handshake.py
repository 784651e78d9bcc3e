"""Answers that do not fit."""

from dataclasses import replace

import pytest
from support.hardware_boards import Bench

from softrobot_env.hardware.errors import ProtocolMismatchError, RobotError
from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import encode
from softrobot_env.hardware.protocol.session import Phase
from softrobot_env.hardware.robot_file import Supervision, rig_file, virtual_file


def hello_ack(bench, **changes):
    ack = m.HelloAck(77, 1, 0x0203, 1, 1, m.SCHEMA, 3, 15, 0)
    return bench.session.receive(encode(replace(ack, **changes), 0), bench.now)


def test_a_fault_is_known_by_its_kind_until_its_report_comes():
    bench = Bench()
    hello_ack(bench)
    numbers = {"applied": (0,) * 3, "length": (0,) * 3, "force": (0,) * 3, "adc": (0,) * 4}
    counts = {"vbus": 6000, "crc_errors": 0, "frame_errors": 0}
    latched = {"state": m.DeviceState.LATCHED, "n": 3, "faults": 1 << m.Fault.STALL}
    latched |= {"warnings": 0, "session": 0}
    state = m.State(t_dev=0, last_seq=0, t_host_echo=0, **latched, **numbers, **counts)
    bench.session.receive(encode(state, 1), bench.now)
    assert bench.session.fault.text == "a servo stalled" and not bench.session.fault_reported
    bench.session.receive(encode(m.FaultReport(m.Fault.STALL, 1, -310, 0), 2), bench.now)
    assert bench.session.fault.text == "tendon 2 stalled 3.1 mm behind"


def test_another_protocol_names_both():
    with pytest.raises(ProtocolMismatchError, match=r"firmware 2\.3 speaks protocol 2 to 4.*1:"):
        hello_ack(Bench(), min_protocol=2, max_protocol=4)


def test_another_table_of_messages_is_told_as_such():
    with pytest.raises(ProtocolMismatchError, match="different tables of messages"):
        hello_ack(Bench(), schema=m.SCHEMA ^ 1)


def test_another_number_of_servos_is_refused():
    with pytest.raises(RobotError, match="board drives 6 servos, robot 'rig' has 3"):
        hello_ack(Bench(), n=6)


@pytest.mark.parametrize(
    ("changes", "key", "what"),
    [
        ({"supervision": Supervision(stall=5e-3)}, "stall_mm", m.Capability.LENGTH),
        ({"tendons": virtual_file().tendons}, "max_force_n", m.Capability.FORCE),
        ({"supervision": Supervision(adc_channels=(1,))}, "adc_channels", m.Capability.ADC),
        ({"supervision": Supervision(supply=4.8)}, "supply_v", m.Capability.SUPPLY),
    ],
)
def test_a_board_that_cannot_watch_what_the_file_asks_for_is_refused(changes, key, what):
    bench = Bench(replace(rig_file(), **changes))
    hello_ack(bench, capabilities=15)
    assert bench.session.phase == Phase.IDENTIFIED
    bench = Bench(replace(rig_file(), **changes))
    with pytest.raises(RobotError, match=f"asks for {key}.*not measure {what.name.lower()}"):
        hello_ack(bench, capabilities=15 & ~what)


def test_the_rig_before_its_calibration_needs_only_a_supply():
    bench = Bench()
    hello_ack(bench, capabilities=int(m.Capability.SUPPLY))
    assert bench.session.phase == Phase.IDENTIFIED


def test_an_answer_to_another_hello_is_ignored():
    bench = Bench()
    hello_ack(bench, nonce=78)
    assert bench.session.phase == Phase.NEW


def test_another_configuration_is_not_taken_for_ours():
    bench = Bench()
    hello_ack(bench)
    with pytest.raises(RobotError, match="another configuration"):
        bench.session.receive(encode(m.ConfigAck(1), 1), bench.now)
