"""What a router that was stalled drops, on real sockets."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from array import array
from collections.abc import Iterator

import pytest
from fleet import command, slice_of
from pymavlink.dialects.v20 import common as mavlink

from arena.mavlink_router.routing_table import Table
from arena.mavlink_router.shell import RouterShell
from arena.process_context import ProcessContext
from arena.wire.age_limits import OTHER_LIMIT_S, SETPOINT_LIMIT_S
from arena.wire.mavlink_codec import Codec
from tests.kernel_stamps import kernel_stamps  # noqa: F401 - a fixture of this module

HOST = "127.54.9.1"
TRIES = 20


class Stalled:
    """A router in this process, its vehicle and its program. It reads nothing until `wake`."""

    def __init__(self, real: bool = True) -> None:
        settings = slice_of((1,), host=HOST, gcs=(HOST, 14550), real=(1,) if real else ())
        self.shell = RouterShell(ProcessContext("router", settings, None), Table.from_slice(settings))
        vehicle = settings["vehicles"][0]
        self.serve = tuple(vehicle["serve"])
        self.vehicle, self.program = udp(vehicle["link"]["remote"]), udp(vehicle["clients"][0]["address"])
        self.codec, self.reader = Codec(1, 191), Codec(1, 1)

    def send(self, message: mavlink.MAVLink_message) -> None:
        self.program.sendto(self.codec.pack(message), self.serve)

    def setpoint(self, number: int) -> None:
        self.send(mavlink.MAVLink_set_position_target_local_ned_message(number, 1, 1, 1, 0xDF8, *[0.0] * 11))

    def wake(self) -> list[mavlink.MAVLink_message]:
        """Let the router read everything that waits. Return what the vehicle then has received."""
        found = []
        for _ in range(300):
            self.shell.turn(0.0)
        with contextlib.suppress(BlockingIOError):
            while True:
                found += self.reader.parse(self.vehicle.recv(65536))
        return [m for m in found if m.get_type() != "HEARTBEAT"]


def udp(address: list[object]) -> socket.socket:
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.bind((str(address[0]), int(str(address[1]))))
    s.setblocking(False)
    return s


def wait(seconds: float) -> None:
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        select.select([], [], [], left)


@contextlib.contextmanager
def stalled(real: bool = True) -> Iterator[Stalled]:
    router = Stalled(real)
    try:
        yield router
    finally:
        router.shell.close()
        router.vehicle.close()
        router.program.close()


def test_a_stalled_router_does_not_replay_setpoints():  # review fault 13
    """Repeated if the machine stands still for so long that the young messages become old, too."""
    for _ in range(TRIES):
        with stalled() as router:
            router.wake()
            for i in range(150):
                router.setpoint(i)
            param_at = time.monotonic()
            router.send(mavlink.MAVLink_param_set_message(1, 1, b"A", 1.0, 9))
            wait(0.5)
            setpoint_at = time.monotonic()
            router.setpoint(1000)
            got = router.wake()
            end = time.monotonic()
            dropped = router.shell._stats()["dropped"]["waited too long"]
        if in_time := end - param_at < OTHER_LIMIT_S and end - setpoint_at < SETPOINT_LIMIT_S:
            break
    assert in_time, "the machine stood still in each try"
    assert [m.time_boot_ms for m in got if "TARGET" in m.get_type()] == [1000]
    assert [m.get_type() for m in got if "PARAM" in m.get_type()] == ["PARAM_SET"]
    assert dropped == 150


def test_a_router_that_reads_at_once_drops_nothing():
    with stalled() as router:
        got = []
        for i in range(50):
            router.setpoint(i)
            got += router.wake()
        assert [m.time_boot_ms for m in got] == [*range(50)]
        assert "waited too long" not in router.shell._stats()["dropped"]


@pytest.mark.parametrize(("passed_s", "forwarded"), [(0.0, 5), (0.05, 5), (3.0, 0)])
def test_age_of_simulated_vehicles_is_limited_by_simulation_time(passed_s, forwarded):
    with stalled(real=False) as router:
        world_s = array("d", [10.0])
        router.shell._backlog.waits.world_s = world_s
        router.shell._backlog._simulated = True
        router.wake()
        for i in range(5):
            router.setpoint(i)
        wait(0.4)
        world_s[0] += passed_s
        assert len(router.wake()) == forwarded


def test_telemetry_that_waited_is_forwarded():
    with stalled() as router:
        router.wake()
        ack = mavlink.MAVLink_command_ack_message(400, 0)
        router.vehicle.sendto(Codec(1, 1).pack(ack), tuple(router.shell._router.sockets[1]))
        wait(0.3)
        router.wake()
        assert router.shell._router.counts.frames_from_vehicles == 1


def test_commands_older_than_a_second_are_dropped():
    with stalled() as router:
        router.wake()
        router.program.sendto(command(1, (1, 191)), router.serve)
        wait(1.2)
        router.program.sendto(command(1, (1, 191)), router.serve)
        assert len(router.wake()) == 1
