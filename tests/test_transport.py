"""Ages of received datagrams: the kernel's receive stamps, and clocks that are set meanwhile."""

from __future__ import annotations

import select
import socket
import time

import pytest

from arena.transport import AgedSocket, StampAges, open_udp
from tests.kernel_stamps import until_stamped

HOST = "127.75.1.1"


def test_age_is_the_time_since_the_stamp():
    ages = StampAges(1000.0, 50.0)
    assert ages.age_s(1000.5, 1001.5, 51.5, 1.4) == pytest.approx(1.0)


@pytest.mark.parametrize("step_s", [3600.0, -3600.0, 1.0, -1.0, 0.3, -0.3])
@pytest.mark.parametrize("stamped_before_the_step", [True, False])
def test_a_clock_that_is_set_while_datagrams_wait_makes_none_younger(step_s, stamped_before_the_step):
    ages = StampAges(1000.0, 50.0)
    true_age, longest_s = 2.0, 2.5
    arrived_by_wall = 1000.0 + 3.0 - true_age + (0.0 if stamped_before_the_step else step_s)
    age = ages.age_s(arrived_by_wall, 1003.0 + step_s, 53.0, longest_s)
    assert true_age - 0.01 <= age <= longest_s


@pytest.mark.parametrize("step_s", [3600.0, -3600.0, 0.3, -0.3])
def test_a_step_of_the_clock_is_forgotten_after_ten_seconds(step_s):
    ages = StampAges(1000.0, 50.0)
    for i in range(50):
        ages.update(1000.0 + step_s + 0.25 * i, 50.0 + 0.25 * i)
    now = 62.5
    assert ages.age_s(1012.49 + step_s, 1012.5 + step_s, now, 5.0) == pytest.approx(0.01, abs=1e-6)


def test_an_adjusted_clock_is_no_step():
    ages = StampAges(1000.0, 50.0)
    for i in range(400):  # 500 ppm
        ages.update(1000.0 + 0.25 * i * 1.0005, 50.0 + 0.25 * i)
    wall, now = 1000.0 + 100.0 * 1.0005, 150.0
    assert ages.age_s(wall - 0.02, wall, now, 1.0) == pytest.approx(0.02, abs=0.001)


def test_a_stamp_that_fits_no_clock_gives_the_greatest_possible_age():
    assert StampAges(1000.0, 50.0).age_s(5.0, 1001.0, 51.0, 0.7) == 0.7


def test_a_socket_returns_the_age_of_what_waited():
    now = time.monotonic()
    receiving = AgedSocket(open_udp((HOST, 0)), StampAges(time.time(), now), now)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        sending.bind((HOST, 0))
        to = receiving._source.getsockname()
        try:
            until_stamped(sending, receiving)
            now = time.monotonic()
            sending.sendto(b"old", to)
            while time.monotonic() < now + 0.3:
                select.select([], [], [], 0.3)
            sending.sendto(b"new", to)
            (old, _, old_s), (new, sender, new_s) = receiving.receive()
        finally:
            receiving.close()
        assert (old, new, sender) == (b"old", b"new", sending.getsockname())
    # the two clocks that give the age were not read at the same instant
    assert 0.25 < old_s <= time.monotonic() - now + 0.05
    assert old_s - new_s > 0.2
