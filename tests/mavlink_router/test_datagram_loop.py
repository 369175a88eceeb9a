"""The compiled loop of the router and the loop in Python forward the same datagrams, on real sockets."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time

import pytest
from fleet import ack, attitude, command, heartbeat, slice_of
from pymavlink.dialects.v20 import common as mavlink
from test_shortcut import odometry

from arena.mavlink_router.routing_table import Table
from arena.mavlink_router.shell import RouterShell
from arena.process_context import ProcessContext
from arena.wire.age_limits import age_limit_s
from tests.kernel_stamps import kernel_stamps  # noqa: F401 - a fixture of this module
from tests.kernels.kernel_versions import needs_compiled

HOST = "127.54.11.1"
RECORDER = (HOST, 24002)
SETPOINT = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
BURST = 40  # more than the loop reads at a time


def udp(address):
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.bind(tuple(address))
    s.setblocking(False)
    return s


def setpoint(seq):
    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    codec.seq = seq
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0, 0.0, 0, -1.0, 0, 0, 0, 0, 0, 0, 0, 0
    ).pack(codec)


class Running:
    """A router in this process with one vehicle, its clients and the recorder."""

    def __init__(self, compiled):
        settings = slice_of((1,), host=HOST, gcs=(HOST, 14550), heartbeat=False, real=(1,), recorder=RECORDER)
        vehicle = settings["vehicles"][0]
        self.shell = RouterShell(ProcessContext("router", settings, None), Table.from_slice(settings))
        if not compiled:
            self.shell._loop = None
        self.link, self.serve = tuple(vehicle["link"]["local"]), tuple(vehicle["serve"])
        self.autopilot = udp(vehicle["link"]["remote"])
        self.program, self.sdk = (udp(c["address"]) for c in vehicle["clients"])
        self.gcs = udp((HOST, 14550))
        self.recorder = udp(RECORDER)
        self.serve_and_tools = [tuple(vehicle["serve"]), tuple(vehicle["tools"])]
        self.receivers = (self.autopilot, self.program, self.sdk, self.gcs)

    def close(self):
        self.shell.close()
        for s in (*self.receivers, self.recorder):
            s.close()

    def turn(self, count=BURST + 10):
        for _ in range(count):
            self.shell.turn(0.0)

    def recorded(self):
        """Return (up, datagram) of all datagrams that the recorder has received."""
        found = []
        with contextlib.suppress(BlockingIOError):
            while True:
                data, sender = self.recorder.recvfrom(65536)
                found.append((self.serve_and_tools.index(sender) == 1, data))
        return found

    def received(self):
        """Return all datagrams of each receiver."""
        found = []
        for s in self.receivers:
            found.append([])
            with contextlib.suppress(BlockingIOError):
                while True:
                    found[-1].append(s.recv(65536))
        return found


@pytest.fixture(params=[pytest.param(True, marks=needs_compiled), False], ids=["compiled", "interpreted"])
def running(request):
    router = Running(request.param)
    yield router
    router.close()


def test_a_burst_reaches_all_receivers_in_order(running):
    frames = [attitude(1, 1 + i) for i in range(BURST)]
    running.autopilot.sendto(attitude(1), running.link)
    running.turn()
    running.received()
    for frame in frames:
        running.autopilot.sendto(frame, running.link)
    running.program.sendto(odometry((1, 191)), running.serve)
    running.turn()
    assert running.received() == [[odometry((1, 191))], frames, frames, frames]
    counts = running.shell._router.counts
    assert counts.bytes_out == 4 * sum(map(len, frames)) + 4 * len(attitude(1)) + 2 * len(odometry((1, 191)))
    assert counts.frames_from_vehicles == BURST + 1 and counts.frames_to_vehicles == 1


def test_datagrams_for_python_keep_their_place_in_the_order(running):
    """Status, replies to one client and broken datagrams are routed by Python, between ordinary datagrams."""
    frames = [
        heartbeat(1),
        attitude(1),
        ack((1, 191)),
        attitude(1, 2),
        b"broken",
        attitude(1, 3),
        attitude(1) * 30,
        attitude(1, 4),
    ]
    running.program.sendto(command(1, (1, 191)), running.serve)
    running.turn()
    assert running.received()[0] == [command(1, (1, 191))]
    running.recorded()
    for frame in frames:
        running.autopilot.sendto(frame, running.link)
    running.turn()
    _, program, sdk, _ = running.received()
    for_all = [heartbeat(1), attitude(1), attitude(1, 2), attitude(1, 3), attitude(1) * 30, attitude(1, 4)]
    assert sdk == for_all
    assert program == [data for _, data in running.recorded()] == [*for_all[:2], ack((1, 191)), *for_all[2:]]
    assert running.shell._router.counts.dropped == {"garbage bytes": 6, "wrong CRC": 0}
    assert running.shell._router.changed_facts() == {}, "they were reported after the cycle"


def test_a_long_datagram_is_split_into_ethernet_frames(running):
    data = attitude(1) * 1500
    running.autopilot.sendto(data, running.link)
    running.turn()
    for datagrams in running.received()[1:]:
        assert b"".join(datagrams) == data
        assert max(map(len, datagrams)) <= 1472 + len(attitude(1))


def test_a_turn_ends_at_its_time_although_nothing_arrives(running):
    for _ in range(3):
        began = time.monotonic()
        running.shell.turn(0.05)
        assert time.monotonic() - began >= 0.05
    running.shell.turn(0.0)
    assert not select.select([running.program], [], [], 0)[0]


def test_other_threads_run_while_the_router_waits(running):
    """The compiled loop keeps the interpreter lock only if there is no other thread."""
    ran_at, over = [], threading.Event()

    def run():
        while not over.wait(0.01):
            ran_at.append(time.monotonic())

    thread = threading.Thread(target=run)
    thread.start()
    running.shell.turn(0.0)
    began = time.monotonic()
    running.shell.turn(1.0)
    ended = time.monotonic()
    over.set()
    thread.join()
    assert [at for at in ran_at if began < at < ended - 0.5]


@needs_compiled
def test_the_timer_of_the_loop_does_not_wake_the_poll_of_python():
    router = Running(compiled=True)
    try:
        router.program.sendto(heartbeat(1, 191), router.serve)
        router.shell.turn(0.2)  # ends early, so that the timer is still set
        router.shell._in_loop = False
        router.shell.turn(0.0)
        assert router.shell._poll.poll(0.3) == []
    finally:
        router.close()


def test_setpoint_that_became_old_while_the_round_was_stalled_is_dropped(running, monkeypatch):
    """The process stands still after the poll, while it sends the autopilot's heartbeat, as after SIGSTOP."""
    send, stalled = running.shell._send, []

    def stall(out):
        if not stalled:
            stalled.append(True)
            time.sleep(2.0 * age_limit_s(SETPOINT))
            running.program.sendto(setpoint(1), running.serve)
        send(out)

    running.autopilot.sendto(heartbeat(1), running.link)
    running.program.sendto(setpoint(9), running.serve)
    running.turn()
    running.received()
    monkeypatch.setattr(running.shell, "_send", stall)
    running.autopilot.sendto(heartbeat(1), running.link)
    running.program.sendto(setpoint(0), running.serve)
    running.turn()
    got = b"".join(running.received()[0])
    assert stalled and setpoint(0) not in got, "the setpoint from before the stall"
    assert setpoint(1) in got, "the setpoint from its end"


def test_datagram_that_became_old_between_poll_and_reading_is_dropped(running):
    """The process stands still just before it reads: nobody knows when the datagram has arrived, so it counts as old."""
    names = [s.getsockname() for s in running.shell._sockets]
    key, sender = names.index(running.serve), running.program.getsockname()
    running.shell._on_late_datagram(key, sender, memoryview(setpoint(1)), time.monotonic())
    later = time.monotonic() + 2.0 * age_limit_s(SETPOINT)
    running.shell._on_late_datagram(key, sender, memoryview(setpoint(2)), later)
    assert running.received()[0] == [setpoint(1)]
    assert running.shell._backlog.dropped == 1


def test_recorder_receives_both_directions_of_a_burst(running):
    running.autopilot.sendto(attitude(1), running.link)
    running.program.sendto(odometry((1, 191)), running.serve)
    running.turn()
    running.received()
    running.recorded()
    down, up = [attitude(1, 1 + i) for i in range(BURST)], [setpoint(i) for i in range(BURST)]
    for frame in down:
        running.autopilot.sendto(frame, running.link)
    for frame in up:
        running.program.sendto(frame, running.serve)
    running.turn()
    found = running.recorded()
    assert [data for is_up, data in found if not is_up] == down
    passed_on = running.received()[0]
    assert passed_on
    assert [data for is_up, data in found if is_up] == passed_on
