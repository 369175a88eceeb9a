"""Frame numbers: new, repeated, or of a restarted server."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from arena.mocap.client.frame_order import FrameOrder


@given(st.lists(st.integers(-(2**31), 2**31 - 1), max_size=60))
def test_new_numbers_rise_until_a_restart(numbers):
    order, newest = FrameOrder(), None
    for number in numbers:
        place = order.place(number)
        if place == "new":
            assert newest is None or number > newest
        if place != "repeated":
            newest = number


def test_restart_takes_nine_old_numbers_that_count_up():
    order = FrameOrder()
    order.place(100)
    assert [order.place(n) for n in range(8)] == ["repeated"] * 8
    order.place(101)
    assert [order.place(50)] * 20 == ["repeated"] * 20
    assert [order.place(n) for n in range(1, 10)] == ["repeated"] * 8 + ["restarted"]
    assert order.place(10) == "new"
