"""The simulation clock: told, woken, waited for, struck off."""

from __future__ import annotations

import os
import threading
import time

import pytest

from arena.clock import ClockServer, SimClock, WallClock
from arena.errors import RunError


@pytest.fixture
def server(tmp_path):
    server = ClockServer(tmp_path / "clock")
    yield server
    server.close()


def in_thread(work):
    """Run work() beside the test; returns the thread and the list its result lands in."""
    found = []
    thread = threading.Thread(target=lambda: found.append(work()), daemon=True)
    thread.start()
    return thread, found


def serve_until(server, condition, now=0.0, deadline_s=5.0):
    end = time.monotonic() + deadline_s
    while not condition():
        assert time.monotonic() < end, "the clock's client did not get there in time"
        server.poll(0.01)
        server.tick(now)


def test_a_sleeper_is_woken_when_its_time_has_come_and_not_before(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "p")
    thread, found = in_thread(lambda: clock.sleep_until(1.0))
    serve_until(server, lambda: any(s.wake == 1.0 for s in server._sleepers.values()), now=0.5)
    server.tick(0.996)
    assert thread.is_alive()
    server.tick(1.0)
    thread.join(5)
    assert found == [1.0]
    assert clock.now() == 1.0


def test_a_time_already_past_wakes_at_once(server, tmp_path):
    server.tick(7.0)
    clock = SimClock(tmp_path / "clock", "p")
    thread, found = in_thread(lambda: clock.sleep_until(3.0))
    serve_until(server, lambda: bool(found), now=7.0)
    thread.join(5)
    assert found == [7.0]


def test_lockstep_waits_for_who_is_awake_and_strikes_off_who_hangs(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "hung.py")
    serve_until(server, lambda: any(s.name for s in server._sleepers.values()))
    assert server.may_pass(0.0, time.monotonic()), "a client that never slept does not hold the world"
    thread, found = in_thread(lambda: clock.sleep_until(0.1))
    serve_until(server, lambda: bool(found), now=0.2)
    thread.join(5)
    woken = time.monotonic()
    assert not server.may_pass(0.2, woken)
    assert server.may_pass(0.2, woken + 1.5) is False or server.struck_off == ["hung.py"]
    assert server.may_pass(0.2, woken + 1.6)
    assert server.struck_off == ["hung.py"]


def test_the_end_of_the_world_is_an_error_and_not_a_hang(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "p")

    def sleep():
        try:
            return clock.sleep_until(100.0)
        except RunError as error:
            return str(error)

    thread, found = in_thread(sleep)
    serve_until(server, lambda: any(s.wake for s in server._sleepers.values()))
    server.close()
    thread.join(5)
    assert "ended" in found[0]


def test_no_world_is_a_sentence(tmp_path):
    with pytest.raises(RunError, match="is the arena up"):
        SimClock(tmp_path / "clock", "p")


def test_garbage_from_a_client_is_ignored(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "p")
    clock._socket.send(b"x" * 100)
    clock._socket.send(b"")
    server.poll(0.05)
    server.tick(1.0)
    assert server.may_pass(1.0, time.monotonic())


def test_a_rate_keeps_absolute_deadlines_and_skips_what_it_missed():
    class Fake(WallClock):
        t = 0.0

        def now(self):
            return self.t

        def sleep_until(self, t):
            self.t = max(self.t, t)
            return self.t

    clock = Fake()
    rate = clock.rate(10.0)
    assert [round(rate.sleep(), 6) for _ in range(3)] == [0.1, 0.2, 0.3]
    clock.t = 0.95
    assert round(rate.sleep(), 6) == 0.95
    assert round(rate.sleep(), 6) == 0.95
    assert round(rate.sleep(), 6) == 1.05


def test_a_client_knows_whose_clock_it_is(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "p")
    assert clock.server_pid == os.getpid()
    clock.close()
