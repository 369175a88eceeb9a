"""Messages that the listener requests and receives."""

from __future__ import annotations

import socket
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from arena.plan import Plan
from arena.smoke.flying.telemetry_listener import TelemetryListener
from arena.wire.mavlink_ids import REFEREE


def test_heartbeats_and_missing_rates_are_requested(plan: Plan):
    tools = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in plan.vehicles]
    for sock, vehicle in zip(tools, plan.vehicles, strict=True):
        sock.bind((vehicle.router.partner_host, vehicle.tools_port))
        sock.settimeout(60)
    listener, voice = (
        TelemetryListener(plan.vehicles),
        mavlink.MAVLink(None, srcSystem=plan.vehicles[0].id, srcComponent=1),
    )
    try:
        listener.listen(1.0)
        asked, sender = _asked(tools[0], 3)
        assert {(m.command, m.param1) for m in asked} == {(512, 0), (511, 245), (511, 85)}
        assert {m.get_srcSystem() for m in asked} == {REFEREE.system} and all(
            m.target_system == 1 for m in asked
        )
        messages = [
            mavlink.MAVLink_heartbeat_message(2, 12, 128 | 1, 6 << 16, 3, 3),
            mavlink.MAVLink_extended_sys_state_message(0, 2),
            mavlink.MAVLink_local_position_ned_message(1020, 1, 2, 3, 0, 0, 0),
        ]
        for message in messages:
            tools[0].sendto(message.pack(voice), sender)
        listener.listen(1.04)
        heart, ground = listener.telemetry["uav1"].heartbeat, listener.telemetry["uav1"].ground
        assert heart and heart.mode == "OFFBOARD" and heart.armed and ground and not ground.landed
        assert [m.command for m in _asked(tools[0], 1)[0]] == [512]  # the rates are right
    finally:
        listener.close()
        for sock in tools:
            sock.close()


def _asked(sock: socket.socket, count: int) -> tuple[list[Any], Any]:
    found, parser, sender = [], mavlink.MAVLink(None), None
    for _ in range(count):
        data, sender = sock.recvfrom(2048)
        found += parser.parse_buffer(data)
    return found, sender
