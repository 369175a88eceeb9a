"""The simulation clock: time, wake-ups, lockstep and clients that hang."""

from __future__ import annotations

import os
import threading
import time

import pytest

from arena.clock import LockstepClock, SimClock, WallClock
from arena.clock_server import ClockServer
from arena.errors import RunError


@pytest.fixture
def server(tmp_path):
    server = ClockServer(tmp_path / "clock")
    yield server
    server.close()


def in_thread(work):
    """Run work() in a thread; return the thread and the list that gets its result."""
    found = []
    thread = threading.Thread(target=lambda: found.append(work()), daemon=True)
    thread.start()
    return thread, found


def serve_until(server, condition, now=0.0, deadline_s=60.0):
    end = time.monotonic() + deadline_s
    while not condition():
        assert time.monotonic() < end, "the clock's client was not ready in time"
        server.poll(0.01)
        server.tick(now)


def test_client_is_woken_at_its_time_and_not_before(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "p")
    thread, found = in_thread(lambda: clock.sleep_until(1.0))
    serve_until(server, lambda: any(s.wake == 1.0 for s in server._clients.values()), now=0.5)
    server.tick(0.996)
    assert thread.is_alive()
    server.tick(1.0)
    thread.join(60)
    assert found == [1.0]
    assert clock.now() == 1.0


def test_server_lists_who_sleeps_and_calls_before_each_wake_up(server, tmp_path):
    woken = []
    server.before_wake = lambda name: woken.append((name, name in server.asleep))
    client = SimClock(tmp_path / "clock", "uav1")
    server.poll(1.0)
    client.request_wake(0.5)
    server.poll(1.0)
    while "uav1" not in server.asleep:
        server.poll(1.0)
    server.tick(0.4)
    assert woken == []
    server.tick(0.5)
    assert woken == [("uav1", False)]
    assert client.wait_for_wake(10.0) == 0.5
    client.request_wake(1.0)
    while "uav1" not in server.asleep:
        server.poll(1.0)
    client.close()
    while server.asleep:
        server.poll(1.0)


def test_past_wake_time_wakes_at_once(server, tmp_path):
    server.tick(7.0)
    clock = SimClock(tmp_path / "clock", "p")
    thread, found = in_thread(lambda: clock.sleep_until(3.0))
    serve_until(server, lambda: bool(found), now=7.0)
    thread.join(60)
    assert found == [7.0]


def test_lockstep_waits_for_awake_clients_and_drops_hung_ones(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "hung.py")
    serve_until(server, lambda: any(s.name for s in server._clients.values()))
    assert server.may_advance(0.0, time.monotonic()), "a client that never slept does not stop the world"
    thread, found = in_thread(lambda: clock.sleep_until(0.1))
    serve_until(server, lambda: bool(found), now=0.2)
    thread.join(60)
    woken = time.monotonic()
    assert not server.may_advance(0.2, woken)
    assert not server.may_advance(0.2, woken + 30.0), "the whole computer stood still: nobody is dropped"
    waited = [server.may_advance(0.2, woken + 30.0 + 0.05 * k) for k in range(1, 30)]
    assert not any(waited[:10]) and waited[-1] and server.dropped == ["hung.py"]


def test_dropped_loop_with_a_fixed_rate_is_waited_for_again(server, tmp_path):
    """After a long computation `Rate.sleep` asks for a time in the past first."""
    clock = SimClock(tmp_path / "clock", "loop.py")
    thread, _ = in_thread(lambda: clock.sleep_until(0.1))
    serve_until(server, lambda: "loop.py" in server.asleep)
    server.tick(0.2)
    thread.join(60)
    woken = time.monotonic()
    for k in range(30):  # it computes
        server.may_advance(0.2, woken + 0.05 * k)
    assert server.dropped == ["loop.py"]
    server.tick(5.0)
    clock.request_wake(0.2)
    serve_until(
        server, lambda: server._clients and next(iter(server._clients.values())).past_requests == 1, now=5.0
    )
    assert clock.wait_for_wake(60.0) == 5.0
    assert not server.may_advance(5.0, time.monotonic()), "the world waits for it again"


def test_request_for_the_past_ends_an_earlier_sleep(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "p")
    clock.request_wake(10.0)
    serve_until(server, lambda: "p" in server.asleep, now=1.0)
    clock.request_wake(0.5)
    serve_until(server, lambda: "p" not in server.asleep, now=1.0)
    assert clock.wait_for_wake(60.0) == 1.0
    assert not server.may_advance(1.0, time.monotonic()), "it is awake"
    server.tick(10.0)
    assert clock.wait_for_wake(0.1) is None, "and is not woken a second time"


def test_client_that_sleeps_until_a_past_time_does_not_stop_the_world(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "spins.py")
    ended = threading.Event()

    def spin():
        while not ended.is_set():
            clock.sleep_until(0.0)

    thread, _ = in_thread(spin)
    try:
        serve_until(server, lambda: "spins.py" in server.joined, now=0.1)
        end = time.monotonic() + 60.0
        while not server.may_advance(0.1, time.monotonic()):
            server.wait_for_requests(0.001)
            assert time.monotonic() < end
        assert server.dropped == ["spins.py"]
        server.wait_for_requests(0.001)
        assert server.may_advance(0.1, time.monotonic()) and server.dropped == ["spins.py"]
    finally:
        ended.set()
        serve_until(server, lambda: not thread.is_alive(), now=0.1)


def test_wait_for_requests_reads_the_clients_that_are_awake(server, tmp_path):
    clocks = [SimClock(tmp_path / "clock", name) for name in "pq"]
    threads = [in_thread(lambda c=c: (c.sleep_until(0.1), c.sleep_until(0.2))) for c in clocks]
    serve_until(server, lambda: [c.wake for c in server._clients.values()] == [0.1, 0.1])
    server.tick(0.1)
    end = time.monotonic() + 60.0
    while not server.wait_for_requests(0.01):
        assert time.monotonic() < end
    assert [c.wake for c in server._clients.values()] == [0.2, 0.2]
    server.tick(0.2)
    for thread, _ in threads:
        thread.join(60)
    assert not server.wait_for_requests(0.01), "both are awake and silent"


def test_new_client_is_accepted_while_another_is_awake(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "awake")
    thread, found = in_thread(lambda: clock.sleep_until(0.1))
    serve_until(server, lambda: bool(found), now=0.2)
    SimClock(tmp_path / "clock", "new")
    end = time.monotonic() + 60.0
    while len(server._clients) < 2:
        assert not server.wait_for_requests(0.01) and time.monotonic() < end
    thread.join(60)


def test_end_of_the_world_ends_a_sleep_with_an_error(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "p")

    def sleep():
        try:
            return clock.sleep_until(100.0)
        except RunError as error:
            return str(error)

    thread, found = in_thread(sleep)
    serve_until(server, lambda: any(s.wake for s in server._clients.values()))
    server.close()
    thread.join(60)
    assert "ended" in found[0]


def test_missing_world_is_an_error(tmp_path):
    with pytest.raises(RunError, match=r"cannot open the simulation clock .* No such file or directory"):
        SimClock(tmp_path / "clock", "p")


def test_invalid_packets_of_a_client_are_ignored(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "p")
    clock._socket.send(b"x" * 100)
    clock._socket.send(b"")
    server.poll(0.05)
    server.tick(1.0)
    assert server.may_advance(1.0, time.monotonic())


def test_rate_keeps_absolute_deadlines_and_skips_missed_ones():
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


def test_client_reads_the_pid_of_the_world(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "p")
    assert clock.server_pid == os.getpid()
    clock.close()


def test_chores_are_done_on_the_sleeping_thread_at_their_period(tmp_path):
    server = ClockServer(tmp_path / "clock", lockstep=True)
    try:
        clock, done = SimClock(tmp_path / "clock", "p"), []
        assert clock.lockstep
        clock.do_while_asleep(
            lambda: done.append((clock.now(), threading.current_thread())), 0.1, lambda at: True
        )
        thread, found = in_thread(lambda: clock.sleep_until(0.35))
        for step in range(1, 36):
            serve_until(server, lambda: all(c.wake is not None for c in server._clients.values()) or found)
            server.tick(0.01 * step)
        serve_until(server, lambda: bool(found), now=0.35)
        assert [round(time_s, 2) for time_s, _ in done] == [0.1, 0.2, 0.3]
        assert {at for _, at in done} == {thread}
    finally:
        server.close()


def test_chores_that_are_not_needed_do_not_end_a_sleep():
    class Sleeps(LockstepClock):
        lockstep = True
        t, wakes = 1.0, ()

        def now(self):
            return self.t

        def sleep_only(self, t):
            self.t, self.wakes = t, (*self.wakes, round(t, 6))
            return t

    clock, done = Sleeps(), []
    clock.do_while_asleep(lambda: done.append(round(clock.t, 6)), 0.1, lambda at: at > 1.25)
    clock.sleep_until(1.15)
    assert clock.sleep_until(1.45) == 1.45
    assert done == [1.3, 1.4] and clock.wakes == (1.15, 1.3, 1.4, 1.45)


def test_server_knows_who_has_joined_and_who_has_left(server, tmp_path):
    clock = SimClock(tmp_path / "clock", "uav1")
    serve_until(server, lambda: any(c.name for c in server._clients.values()))
    assert "uav1" not in server.joined and not server.has_disconnected("uav1")
    clock.request_wake(5.0)
    serve_until(server, lambda: "uav1" in server.joined)
    assert not server.has_disconnected("uav1")
    clock.close()
    serve_until(server, lambda: server.has_disconnected("uav1"))


def test_clock_on_the_wall_is_not_in_lockstep(server, tmp_path):
    assert not SimClock(tmp_path / "clock", "p").lockstep
