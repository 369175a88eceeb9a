"""The connection of a program: motion capture and measurements of relative sensors."""

from __future__ import annotations

import threading

import pytest
from fake_autopilot import FakeAutopilot
from pymavlink.dialects.v20 import common as mavlink

from arena.clock import LockstepClock, WallClock
from arena.errors import InputError, NotConfirmedError, RunError
from arena.mocap.client import CapturedFrame, Pose
from arena.transport import open_udp
from arena.uav.connection import Connection
from arena.uav.poses import Poses
from arena.uav.receiver import Receiver
from arena.uav.setpoints import Encoder
from arena.wire.mavlink_codec import Codec
from arena.wire.telemetry import Telemetry

from .conftest import free_address, sending_to


class FakeClient:
    """A client whose server has every wanted body, at its own north coordinate. Each frame has it 1 m higher."""

    made: list[FakeClient]

    def __init__(self, settings: dict) -> None:
        self.settings, self.closed, self.number = settings, False, 0
        self.bodies = list(settings["bodies"])
        self.made.append(self)

    def add_body(self, body: str) -> None:
        self.bodies.append(body)

    def poll(self, now: float) -> list[CapturedFrame]:
        self.number += 1
        poses = tuple(
            Pose(b, (self.settings["north"], 0.0, -float(self.number)), (1.0, 0.0, 0.0, 0.0))
            for b in self.bodies
        )
        return [CapturedFrame(self.number, now, poses, ())]

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def clients(monkeypatch):
    monkeypatch.setattr(FakeClient, "made", [], raising=False)
    monkeypatch.setattr("arena.mocap.client.open_client", FakeClient)
    return FakeClient.made


def opened(body, capture, receiver=None, clock=None) -> Connection:
    host, port = free_address()
    return Connection(f"udpin:{host}:{port}", 1, clock or WallClock(), Poses(body), capture, receiver)


def test_only_the_own_body_is_requested_and_stored(clients):
    connection = opened("b1", {"north": 1.0, "bodies": ["b1", "b2"]})
    connection.poll()
    connection.close()
    assert [r.bodies for r in clients] == [["b1"]] and clients[0].closed
    assert connection.poses.own is not None and connection.poses.own.position[0] == 1.0


class StoppedClock(LockstepClock):
    """Simulation clock in lockstep, which the test sets."""

    lockstep = True
    time = 1.0

    def now(self) -> float:
        return self.time

    def sleep_only(self, t: float) -> float:
        raise AssertionError


def test_connections_of_one_process_share_the_client_of_a_server(clients):
    receiver, clock = Receiver(), StoppedClock()
    first, second = (opened(body, {"north": 1.0, "bodies": [body]}, receiver, clock) for body in ("b1", "b2"))
    other = opened("b3", {"north": 2.0, "bodies": ["b3"]}, receiver, clock)
    assert [c.bodies for c in clients] == [["b1", "b2"], ["b3"]]
    first.poll()
    second.poll()
    assert [c.number for c in clients] == [1, 0], "the frames of one time are read once"
    assert [c.poses.own.position[2] for c in (first, second)] == [-1.0, -1.0] and other.poses.own is None
    clock.time = 2.0
    second.poll()
    assert [c.poses.own.received_at for c in (first, second)] == [2.0, 2.0]
    for connection in (first, second, other):
        connection.close()


def test_chores_are_needed_for_the_heartbeat_or_after_silence(monkeypatch):
    monkeypatch.setattr("arena.uav.connection._HEARTBEAT_S", 1.0)
    clock = StoppedClock()
    connection = opened(None, None, clock=clock)
    connection.poll()
    assert connection.needs_chores(1.02), "no heartbeat was sent"
    vehicle = open_udp(("127.0.0.1", 0))
    codec = Codec(1, 1)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)
    vehicle.sendto(codec.pack(heartbeat), connection._socket.getsockname())
    connection.chores()
    assert codec.parse(vehicle.recv(300))[0].get_type() == "HEARTBEAT"
    assert not connection.needs_chores(1.08)
    assert connection.needs_chores(1.1)
    clock.time = 1.98
    connection.poll()
    assert not connection.needs_chores(2.0)
    assert connection.needs_chores(2.01), "the heartbeat is due"
    connection.close()
    vehicle.close()


def test_shared_client_is_closed_with_its_last_connection_and_opened_again(clients):
    receiver, clock = Receiver(), StoppedClock()
    capture = {"north": 1.0, "bodies": []}
    first, second = (opened(body, capture, receiver, clock) for body in ("b1", "b2"))
    first.close()
    first.close()
    clock.time = 2.0
    second.poll()
    assert not clients[0].closed and first.poses.own is None and second.poses.own is not None
    second.close()
    assert clients[0].closed
    third = opened("b1", capture, receiver, clock)
    third.poll()
    third.close()
    assert [c.closed for c in clients] == [True, True] and third.poses.own is not None


def test_why_a_shared_client_failed_is_known_to_each_connection(clients, monkeypatch):
    def fail(client, now):
        raise InputError("no such server")

    monkeypatch.setattr(FakeClient, "poll", fail)
    receiver, clock = Receiver(), StoppedClock()
    made = [opened(body, {"north": 1.0}, receiver, clock) for body in ("b1", "b2")]
    made[0].poll()
    assert [connection.fault for connection in made] == ["no such server"] * 2
    for connection in made:
        connection.close()


@pytest.mark.parametrize(("body", "capture"), [(None, {"north": 1.0}), ("b1", None)])
def test_without_body_or_settings_no_client_is_opened(clients, body, capture):
    connection = opened(body, capture)
    connection.poll()
    connection.close()
    assert not clients and connection.poses.own is None


class SlowBackend:
    """A backend that receives slowly. As a native library, it must not be closed meanwhile."""

    def __init__(self) -> None:
        self.receives, self.may_end = threading.Event(), threading.Event()
        self.in_receive = self.closed_in_receive = False

    def receive(self, datagram: bytes) -> None:
        self.in_receive = True
        self.receives.set()
        self.may_end.wait(10.0)
        self.in_receive = False

    def close(self) -> None:
        self.closed_in_receive = self.in_receive


def test_backend_is_not_closed_while_another_thread_passes_it_a_datagram(monkeypatch):
    backend, port = SlowBackend(), free_address()
    monkeypatch.setattr("arena.uav.connection._open_backend", lambda name, wire: backend)
    receiver = Receiver()
    receiver.add(other := lambda: None)  # another vehicle of the process, so that the thread runs on
    connection = Connection(f"udpin:{port[0]}:{port[1]}", 1, WallClock(), Poses(None), receiver=receiver)
    with sending_to(port, FakeAutopilot(telemetry=("HEARTBEAT",))):
        assert backend.receives.wait(10.0)
        closing = threading.Thread(target=connection.close)
        closing.start()
        closing.join(0.2)  # without the mend, the backend is closed here
        backend.may_end.set()
        closing.join(10.0)
    receiver.remove(other)
    assert not closing.is_alive() and not backend.closed_in_receive


def test_refresh_waits_for_the_thread_that_stores_new_telemetry(monkeypatch):
    """After a stall of the program, its autopilot would else count as silent."""
    storing, may_store, found, store = threading.Event(), threading.Event(), [], Telemetry.on_datagram

    def slow(telemetry: Telemetry, *given: object) -> bool:
        storing.set()
        may_store.wait(60.0)
        return store(telemetry, *given)

    monkeypatch.setattr(Telemetry, "on_datagram", slow)
    monkeypatch.setattr("arena.uav.connection._MIN_REFRESH_S", 60.0)
    port = free_address()
    connection = Connection(f"udpin:{port[0]}:{port[1]}", 1, WallClock(), Poses(None))

    def read() -> None:
        connection.refresh()
        found.append(connection.telemetry.heartbeat)

    with sending_to(port, FakeAutopilot(telemetry=("HEARTBEAT",))):
        assert storing.wait(60.0)
        reading = threading.Thread(target=read)
        reading.start()
        reading.join(0.2)  # without the mend, it reads no heartbeat here
        may_store.set()
        reading.join(60.0)
    connection.close()
    assert found[0] is not None


class FailingBackend:
    """A backend that cannot process its first datagram."""

    def __init__(self) -> None:
        self.received = 0
        self.again = threading.Event()

    def receive(self, datagram: bytes) -> None:
        self.received += 1
        if self.received == 1:
            raise ValueError("no such field")
        self.again.set()

    def close(self) -> None:
        pass


def test_exception_of_one_connection_reaches_its_program_and_no_other_vehicle(monkeypatch):
    backends = [FailingBackend(), FailingBackend()]
    backends[1].received = 1  # the second connection receives without an exception
    waiting = iter(backends)
    monkeypatch.setattr("arena.uav.connection._open_backend", lambda name, wire: next(waiting))
    receiver, ports = Receiver(), [free_address(), free_address()]
    failing, other = (
        Connection(f"udpin:{host}:{port}", 1, WallClock(), Poses(None), receiver=receiver)
        for host, port in ports
    )
    with sending_to(ports[0], FakeAutopilot(telemetry=("HEARTBEAT",))):
        assert backends[0].again.wait(10.0), "its next datagrams are processed"
    with sending_to(ports[1], FakeAutopilot(telemetry=("HEARTBEAT",))):
        assert backends[1].again.wait(10.0), "the thread serves the other connection"
    with pytest.raises(RunError, match=f"{ports[0][0]}.* could not be processed: ValueError: no such field"):
        failing.refresh()
    failing.refresh()
    other.refresh()
    for connection in (failing, other):
        connection.close()


def test_closed_connection_sends_nothing_and_raises():
    port = free_address()
    connection = Connection(f"udpout:{port[0]}:{port[1]}", 1, WallClock(), Poses(None))
    connection.send(Encoder(1).pos_yaw([0.0, 0.0, -1.0], 0.0, 0.0))
    connection.close()
    with pytest.raises(NotConfirmedError, match="is closed"):
        connection.send_setpoint(Encoder(1).pos_yaw([0.0, 0.0, -1.0], 0.0, 0.0))
    with pytest.raises(NotConfirmedError, match="is closed"):
        connection.command(400)


def test_datagrams_behind_one_that_fails_are_processed_by_the_next_poll(monkeypatch):
    backend = FailingBackend()
    monkeypatch.setattr("arena.uav.connection._open_backend", lambda name, wire: backend)
    connection = opened(None, None, clock=StoppedClock())
    codec, vehicle = Codec(1, 1), open_udp(("127.0.0.1", 0))
    for _ in range(3):
        heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)
        vehicle.sendto(codec.pack(heartbeat), connection._socket.getsockname())
    with pytest.raises(ValueError, match="no such field"):
        connection.poll()
    assert backend.received == 1
    connection.poll()
    assert backend.received == 3
    connection.close()
    vehicle.close()


class LosingClient(FakeClient):
    """A client that loses the first body in the second of its frames."""

    def poll(self, now: float) -> list[CapturedFrame]:
        first, second = super().poll(now)[0], super().poll(now)[0]
        return [first, CapturedFrame(second.number, now, second.poses[1:], (self.bodies[0],))]


def test_newest_pose_of_each_body_is_stored(clients, monkeypatch):
    monkeypatch.setattr("arena.mocap.client.open_client", LosingClient)
    receiver, clock = Receiver(), StoppedClock()
    lost, seen = (opened(body, {"north": 1.0}, receiver, clock) for body in ("b1", "b2"))
    lost.poll()
    assert (lost.poses.own.position[2], seen.poses.own.position[2]) == (-1.0, -2.0)
    for connection in (lost, seen):
        connection.close()
