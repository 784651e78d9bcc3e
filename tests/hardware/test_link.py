"""Ages of what a microcontroller says, from its clock and the host's, and a link's counters."""

import pytest

from softrobot_env.hardware.protocol.link import DeviceClock, LinkCounters

WRAP = 2**32


def ages(stamps, arrivals, start=0):
    """Age [s] at arrival of messages sent and arrived at times [s]."""
    clock = DeviceClock()
    counts = [round(1e6 * stamp + start) % WRAP for stamp in stamps]
    pairs = zip(counts, arrivals, strict=True)
    return [arrival - clock.taken(count, arrival) for count, arrival in pairs]


def test_what_comes_at_once_has_no_age():
    assert ages([5.0, 5.1, 5.2], [100.0, 100.1, 100.2]) == pytest.approx([0, 0, 0], abs=1e-9)


def test_what_waits_is_as_old_as_it_has_waited():
    found = ages([5.0, 5.1, 5.2, 5.3], [100.0, 100.4, 100.4, 100.4])
    assert found == pytest.approx([0, 0.3, 0.2, 0.1], abs=3e-3)


def test_a_first_message_that_waited_is_found_out():
    assert ages([5.0, 5.1, 5.2], [100.3, 100.1, 100.2]) == pytest.approx([0, 0, 0], abs=1e-9)


def test_the_clock_may_wrap():
    found = ages([0.0, 0.1, 0.2], [100.0, 100.1, 100.25], start=WRAP - 150_000)
    assert found == pytest.approx([0, 0, 0.05], abs=2e-3)


@pytest.mark.parametrize("drift", [-0.005, 0.005])
def test_the_drift_of_a_resonator_is_no_age(drift):
    stamps = [0.05 * k for k in range(2000)]
    arrivals = [stamp * (1 + drift) for stamp in stamps]
    assert max(ages(stamps, arrivals)) < 1e-3


def test_a_clock_that_starts_again_is_believed():
    found = ages([500.0, 500.1, 0.2, 0.3], [1.0, 1.1, 1.6, 1.7])
    assert found == pytest.approx([0, 0, 0, 0], abs=1e-9)


def test_lost_and_doubled_messages_are_counted():
    link = LinkCounters()
    arrived = [link.note_arrival(seq) for seq in (65534, 65535, 65535, 3, 2, 4)]
    assert arrived == [True, True, False, True, False, True]
    assert (link.lost, link.old, link.received) == (3, 2, 4)


def test_a_count_that_begins_anew_is_no_old_message():
    link = LinkCounters()
    assert link.note_arrival(500) and link.note_arrival(0)
    assert (link.lost, link.old) == (0, 0)
