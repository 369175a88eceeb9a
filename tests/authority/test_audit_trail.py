"""Record of the requests to one vehicle."""

from __future__ import annotations

from arena.authority import Kind, Request, Role
from arena.authority.audit import AuditTrail

ARM, SETPOINT = Request(Kind.ARM), Request(Kind.SETPOINT)
PLACE = ("127.0.0.1", 16001)


def test_a_request_is_recorded_with_sender_address_and_result():
    trail = AuditTrail("uav1")
    trail.add(Role.PROGRAM, (1, 191), Request(Kind.MODE, "OFFBOARD"), "pilot has control", PLACE, 1.0)
    trail.add(Role.GROUND_STATION, (255, 190), Request(Kind.WRITE, param="MPC_XY_P"), "", PLACE, 1.0)
    first, second = trail.take()
    assert first == {
        "vehicle": "uav1",
        "role": "program",
        "sender": "1/191",
        "from": "127.0.0.1:16001",
        "request": "mode OFFBOARD",
        "refused": "pilot has control",
    }
    assert second["request"] == "write parameter MPC_XY_P" and trail.take() == []


def test_repeated_requests_and_setpoints_are_not_recorded():
    trail = AuditTrail("uav1")
    for i in range(100):
        trail.add(Role.PROGRAM, (1, 191), SETPOINT, "", PLACE, 0.1 * i)
        trail.add(Role.PROGRAM, (1, 191), ARM, "", PLACE, 0.04 * i)
    assert len(trail.take()) == 1


def test_waiting_entries_are_bounded():
    trail = AuditTrail("uav1")
    for i in range(1000):
        trail.add(Role.PROGRAM, (1, i), ARM, "", PLACE, 1.0)
    assert len(trail.take()) == 256 and trail.lost == 744
