"""The check of a vehicle's hardware uid on a direct connection: another vehicle is not commanded and confirms nothing.

review fault 4
"""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.emergency.identity_check import (
    ANSWER_S,
    REPEAT_S,
    REQUEST_S,
    SILENT_S,
    TELEMETRY_S,
    IdentityCheck,
)

OURS, OTHER = bytes(range(1, 19)), bytes(range(2, 20))
A, B = ("10.0.0.11", 14550), ("10.0.0.12", 14550)


def pack(*messages, system=1, component=1):
    sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    return b"".join(bytes(m.pack(sender)) for m in messages)


def beat():
    return mavlink.MAVLink_heartbeat_message(2, 12, 1, 0, 4, 3)


def version(uid2, uid=0):
    none = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(0, 0, 0, 0, 0, none, none, none, 0, 0, uid, uid2)


def booted(seconds):
    return mavlink.MAVLink_system_time_message(0, int(seconds * 1e3))


class Scene:
    def __init__(self, recorded=A, uid="0102030405060708090a0b0c0d0e0f101112"):
        self.said = []
        self.check = IdentityCheck(system=1, component=200, uid=uid, recorded=recorded, say=self.said.append)

    def receive(self, now, source, *messages, **sender):
        return self.check.receive(pack(*messages, **sender), source, now)

    def asked(self, now):
        return [source for source, _ in self.check.requests(now)]


@pytest.fixture
def scene():
    return Scene()


def test_only_the_recorded_source_is_commanded_before_an_answer(scene):
    assert scene.check.receivers(0.0) == [], "its telemetry may be on the way"
    assert not scene.receive(0.1, B, beat())
    assert scene.check.receivers(TELEMETRY_S) == scene.check.receivers(60.0) == [A]
    assert [Scene(recorded=None).check.receivers(now) for now in (0.0, 60.0)] == [[], []]


def test_telemetry_counts_once_the_uid_has_arrived(scene):
    assert not scene.receive(0.1, A, beat())
    assert scene.asked(0.1) == [A] and scene.asked(0.2) == [] and scene.asked(0.1 + REQUEST_S) == [A]
    assert scene.receive(0.4, A, version(OURS)) and scene.receive(0.5, A, beat())
    assert scene.asked(1.0) == []


def test_another_vehicle_at_the_recorded_source_is_not_commanded(scene):
    scene.check.receivers(0.0)
    scene.receive(0.1, A, beat())
    assert scene.check.receivers(0.9) == [], "its answer is on the way"
    assert not scene.receive(0.3, A, beat(), version(OTHER), beat())
    assert not scene.receive(99.0, A, beat()) and scene.check.receivers(99.0) == []
    assert scene.said == [
        f"another vehicle replies at 10.0.0.11:14550 (hardware uid {OTHER.hex()}, expected {OURS.hex()}): not commanded"
    ]


def test_a_recorded_source_without_uid_is_commanded_and_confirms_nothing(scene):
    for i in range(20):
        assert not scene.receive(0.1 * i, A, beat())
    assert scene.check.receivers(ANSWER_S + 0.1) == [A]


def test_the_vehicle_at_a_new_source_is_commanded_there_only(scene):
    scene.receive(0.1, A, beat(), version(OURS))
    scene.receive(1.0, B, beat())
    assert scene.asked(1.0) == [B] and scene.check.receivers(1.1) == [A]
    assert scene.receive(1.2, B, version(OURS))
    assert scene.check.receivers(1.3) == [B]
    assert not scene.receive(1.4, A, beat()), "the old source must send its uid again"


@pytest.mark.parametrize("change", ["reboot", "silence", "unplugged"])
def test_the_uid_is_checked_again_after_a_change(scene, change):
    scene.receive(0.1, A, booted(500.0), version(OURS))
    assert scene.receive(1.1, A, booted(501.0), beat())
    if change == "unplugged":
        scene.check.forget(A)
    now = 1.3 + (SILENT_S if change == "silence" else 0.0)
    uptime = 2.0 if change == "reboot" else 501.2 + SILENT_S
    assert not scene.receive(now, A, booted(uptime), beat())
    assert scene.check.receivers(now + 60.0) == [] and scene.asked(now) == [A]
    assert not scene.receive(now + 0.1, A, version(OTHER))
    assert scene.receive(now + 0.2, A, version(OURS))
    assert scene.check.receivers(now + 0.3) == [A]


def test_a_checked_vehicle_that_falls_silent_is_still_commanded(scene):
    scene.receive(0.1, A, beat(), version(OURS))
    assert scene.check.receivers(60.0) == [A]


def test_a_reordered_message_is_not_a_reboot(scene):
    scene.receive(0.1, A, booted(500.0), version(OURS))
    assert scene.receive(0.2, A, booted(499.7), beat())


@pytest.mark.parametrize("sender", [{"system": 2}, {"component": 191}])
def test_a_uid_of_another_system_or_component_is_ignored(scene, sender):
    assert not scene.receive(0.1, A, version(OURS), **sender)
    assert scene.asked(0.3) == []


def test_the_short_uid_of_an_old_autopilot_is_enough():
    scene = Scene(uid="00000000000000ff")
    assert scene.receive(0.1, A, version(bytes(18), uid=255))
    assert not scene.receive(0.2, A, version(bytes(18), uid=254))
    assert not scene.receive(0.3, A, version(bytes(18)))


def test_a_flood_of_sources_does_not_displace_the_vehicle(scene):
    scene.receive(0.1, A, beat(), version(OURS))
    for port in range(1, 200):
        scene.receive(0.2, ("10.0.0.99", port), beat())
    assert scene.receive(0.3, A, beat()) and len(scene.asked(0.3)) < 20


def test_a_source_with_another_vehicle_is_asked_again(scene):
    scene.receive(0.1, A, version(OTHER))
    assert scene.check.is_other(A) and not scene.check.is_other(B)
    assert scene.asked(0.2) == [A] and scene.asked(0.9) == [] and scene.asked(0.2 + REPEAT_S) == [A]
    assert scene.receive(2.0, A, version(OURS)) and not scene.check.is_other(A)
