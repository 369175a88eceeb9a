"""What a link process that was stalled sends to the vehicle, on real sockets."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.fcu_link.__main__ import FcuLinkShell
from arena.fcu_link.settings import Settings
from arena.process_context import ProcessContext
from arena.wire.age_limits import OTHER_LIMIT_S, SETPOINT_LIMIT_S
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames
from tests.kernel_stamps import kernel_stamps  # noqa: F401 - a fixture of this module

from .link_rig import ID, arm, odometry, own_address, slice_of, version

TRIES = 20


def setpoint(number: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_set_position_target_local_ned_message(number, ID, 1, 1, 0xDF8, *[0.0] * 11)


def udp(address: tuple[str, int]) -> socket.socket:
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.bind(address)
    s.setblocking(False)
    return s


def received(vehicle: socket.socket) -> list[Any]:
    found: list[Any] = []
    reader = Codec(1, 1)
    with contextlib.suppress(BlockingIOError):
        while True:
            found += reader.parse(vehicle.recv(65536))
    return found


def flush_after_stall(host: str) -> tuple[list[Any], dict[str, int], bool]:
    """Send setpoints, poses and a command to a link that is stalled for 0.5 s, then two setpoints.

    Return what the link sends to the vehicle, its counts, and whether it has read the command and the last setpoints in time.
    """
    raw = slice_of(host, wire={"kind": "udpout", "address": [host, 24090]})
    vehicle, router, vision, panic = (udp((host, port)) for port in (24090, 24001, 24003, 24005))
    shell = FcuLinkShell(ProcessContext("link.uav7", raw, None), Settings.from_slice(raw))
    version_frame = Codec(ID, 1).pack(version())
    shell._core.from_vehicle(version_frame, parse_frames(version_frame), time.monotonic(), (host, 24090))
    program, forwarder, tool = Codec(ID, 191), Codec(ID, 197), Codec(253, 190)
    try:
        for i in range(150):
            router.sendto(program.pack(setpoint(i)), (host, 24000))
            vision.sendto(forwarder.pack(odometry((i * 0.01, 0.0, -1.0))), (host, 24002))
        command_at = time.monotonic()
        panic.sendto(tool.pack(arm(param1=0.0)), (host, 24004))
        end = time.monotonic() + 0.5
        while (left := end - time.monotonic()) > 0:
            select.select([], [], [], left)
        setpoint_at = time.monotonic()
        for i in (1000, 1001):
            router.sendto(program.pack(setpoint(i)), (host, 24000))
        for _ in range(6):
            shell._wait()
            shell._flush(time.monotonic())
        end = time.monotonic()
        in_time = end - command_at < OTHER_LIMIT_S and end - setpoint_at < SETPOINT_LIMIT_S
        return received(vehicle), dict(shell._core.counts), in_time
    finally:
        shell.close()
        for s in (vehicle, router, vision, panic):
            s.close()


def test_a_stalled_link_sends_only_the_newest_setpoint_and_pose():  # review fault 13
    """Repeated if the machine stands still for so long that the young messages become old, too."""
    host = own_address()
    for _ in range(TRIES):
        sent, counts, in_time = flush_after_stall(host)
        if in_time:
            break
    assert in_time, "the machine stood still in each try"
    assert [m.time_boot_ms for m in sent if "TARGET" in m.get_type()] == [1001]
    assert not [m for m in sent if m.get_type() == "ODOMETRY"]
    assert [m.get_type() for m in sent if "COMMAND" in m.get_type()] == ["COMMAND_LONG"]
    assert counts["from router: waited too long"] == 150
    assert counts["from vision: waited too long"] == 150
