"""Telemetry for sleeping programs is joined: same bytes, same order, fewer datagrams, and nothing is held for long."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.mavlink_router.datagrams import MAX_DATAGRAM_BYTES
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

NAME = "held_telemetry"
VERSIONS = [
    pytest.param(interpreted_modules(NAME)[NAME], id="interpreted"),
    pytest.param(compiled_modules(NAME)[NAME], id="compiled", marks=needs_compiled),
]
MAX_HELD_S = 0.1
ONE, TWO, TOOL = (3, ("127.0.0.1", 16001)), (7, ("127.0.0.1", 16002)), (3, ("127.0.0.1", 40000))


class Held:
    def __init__(self, kernel, asleep=("uav1",)):
        self.asleep, self.sent = set(asleep), []
        programs = {ONE: "uav1", TWO: "uav2"}
        self.held = kernel.HeldTelemetry(
            programs, self.asleep, lambda key, data, to: self.sent.append((key, data, to)), MAX_DATAGRAM_BYTES
        )

    def pass_on(self, place, data, now=0.0, *, join=True):
        """Give a datagram to the store, and send it as the router does if it is not held."""
        program = self.held.place(*place)
        if program is None or not self.held.hold(program, data, now, join):
            self.sent.append((place[0], data, place[1]))


@pytest.mark.parametrize("kernel", VERSIONS)
def test_datagrams_for_a_sleeping_program_leave_as_one_before_it_wakes(kernel):
    it = Held(kernel)
    for data in (b"one", b"two", b"three"):
        it.pass_on(ONE, data)
    assert it.sent == []
    it.held.before_wake("uav2")
    assert it.sent == []
    it.held.before_wake("uav1")
    assert it.sent == [(*ONE[:1], b"onetwothree", ONE[1])]
    it.held.before_wake("uav1")
    assert len(it.sent) == 1


@pytest.mark.parametrize("kernel", VERSIONS)
def test_program_that_is_awake_receives_each_datagram_at_once(kernel):
    it = Held(kernel, asleep=())
    it.pass_on(ONE, b"one")
    assert it.sent == [(3, b"one", ONE[1])]


@pytest.mark.parametrize("kernel", VERSIONS)
def test_other_receivers_are_never_held(kernel):
    it = Held(kernel, asleep=("uav1", "uav2", "smoke"))
    it.pass_on(TOOL, b"one")
    assert it.sent == [(3, b"one", TOOL[1])]


@pytest.mark.parametrize("kernel", VERSIONS)
def test_held_datagrams_leave_before_one_that_is_not_held(kernel):
    it = Held(kernel)
    it.pass_on(ONE, b"held")
    it.pass_on(ONE, b"measurement", join=False)
    it.pass_on(ONE, b"held again")
    it.asleep.clear()
    it.pass_on(ONE, b"awake")
    assert [data for _, data, _ in it.sent] == [b"held", b"measurement", b"held again", b"awake"]


@pytest.mark.parametrize("kernel", VERSIONS)
def test_no_datagram_is_held_for_longer_than_the_limit(kernel):
    it = Held(kernel)
    it.pass_on(ONE, b"old", 1.0)
    it.pass_on(ONE, b"new", 1.0 + MAX_HELD_S / 2)
    it.held.step(1.0 + MAX_HELD_S / 2)
    assert it.sent == []
    it.held.step(1.0 + MAX_HELD_S)
    assert it.sent == [(3, b"oldnew", ONE[1])]


@pytest.mark.parametrize("kernel", VERSIONS)
@given(
    st.lists(
        st.tuples(
            st.sampled_from((ONE, TWO, TOOL)),
            st.binary(min_size=1, max_size=900),
            st.sampled_from(("", "sleep uav1", "wake uav1", "sleep uav2", "wake uav2", "step")),
            st.booleans(),
        ),
        max_size=40,
    )
)
def test_each_receiver_gets_the_same_bytes_in_the_same_order(kernel, actions):
    it, wanted = Held(kernel, asleep=()), {}
    for k, (place, data, change, join) in enumerate(actions):
        verb, _, name = change.partition(" ")
        if verb == "sleep":
            it.asleep.add(name)
        elif verb == "wake":
            it.asleep.discard(name)
            it.held.before_wake(name)
        elif verb == "step":
            it.held.step(0.03 * k)
        it.pass_on(place, data, 0.03 * k, join=join)
        wanted[place] = wanted.get(place, b"") + data
    it.held.close()
    received = {}
    for key, data, to in it.sent:
        assert len(data) <= MAX_DATAGRAM_BYTES
        received[key, to] = received.get((key, to), b"") + data
    assert received == wanted
