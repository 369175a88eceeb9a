"""A real vehicle arms only with a permit, and a permit belongs to a vehicle and a moment."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from .link_rig import Rig, arm, heartbeat

REASON = "no arm permit: run arena arm-permit uav7"


def permit(rig: Rig, **changes: Any) -> list[str]:
    """Pass a request of the supervisor to the link, and return the events since the last call."""
    rig.core.on_request({"do": "permit", "vehicle": "uav7", "by": "alice", **changes}, rig.now)
    return rig.core.events()


def permitted() -> Rig:
    rig = Rig(permit=False)
    rig.fly(2.0)
    assert "uav7: arm permit granted by alice" in permit(rig)
    assert rig.reasons() == []
    return rig


def withdrawn(rig: Rig) -> str:
    """Return the event of the withdrawal; "" if the permit remains."""
    found = [e for e in rig.core.events() if "withdrawn" in e]
    assert bool(found) is (not rig.core.permit.by)
    return found[0] if found else ""


def test_review_fault_3_a_vehicle_does_not_arm_without_a_permit():
    rig = Rig(permit=False)
    rig.fly(2.0)
    rig.send("router", arm())
    assert not rig.arming_passed()
    assert rig.reasons() == [REASON]
    assert REASON in {t.text for t in rig.received("router", "STATUSTEXT")}
    permit(rig)
    rig.send("router", arm())
    assert rig.arming_passed()


def test_a_simulated_vehicle_needs_no_permit():
    rig = Rig(permit=False, simulated=True, simulator=["127.71.0.1", 24079])
    rig.fly(2.0)
    assert rig.reasons() == []
    rig.core.events()
    assert permit(rig) == []


def test_review_fault_3_a_vehicle_that_is_not_connected_gets_no_permit():
    rig = Rig(permit=False)
    assert permit(rig) == ["uav7: no arm permit from alice: the vehicle is not connected"]
    rig.fly(2.0)
    assert rig.reasons() == [REASON], "it appeared after the yes"


def test_the_answer_to_each_request_tells_whether_and_why_the_permit_was_refused():
    rig = Rig(permit=False)
    permit(rig)
    first = rig.core.permit.answer
    assert first["by"] == "alice" and first["refusal"] == "the vehicle is not connected"
    rig.fly(2.0)
    permit(rig)
    assert rig.core.permit.answer["refusal"] == "" and rig.core.permit.answer["number"] != first["number"]


def test_the_permit_of_another_vehicle_is_ignored():
    rig = Rig(permit=False)
    rig.fly(2.0)
    permit(rig, vehicle="uav8")
    assert rig.reasons() == [REASON]


def test_review_fault_3_silence_while_disarmed_withdraws_the_permit():
    rig = permitted()
    rig.fly(2.9, telemetry=False)
    assert not withdrawn(rig)
    rig.fly(0.3, telemetry=False)
    assert withdrawn(rig) == (
        "uav7: arm permit of alice withdrawn: no telemetry for 3 s. To fly, run `arena arm-permit uav7`"
    )
    rig.fly(2.0)
    assert rig.reasons() == [REASON]


def test_review_fault_3_a_reboot_withdraws_the_permit():
    rig = permitted()
    rig.receive(mavlink.MAVLink_system_time_message(0, 60_000))
    rig.receive(mavlink.MAVLink_system_time_message(0, 900))
    assert "it has rebooted" in withdrawn(rig)


def test_an_unplugged_device_withdraws_the_permit():
    rig = permitted()
    rig.core.on_opened()
    assert "unplugged" in withdrawn(rig)


@pytest.mark.parametrize("still_armed", [True, False])
def test_an_armed_vehicle_keeps_its_permit(still_armed):
    rig = permitted()
    rig.fly(1.0, armed=True)
    rig.fly(20.0, telemetry=False)
    assert not withdrawn(rig)
    rig.receive(heartbeat(armed=still_armed))
    assert bool(withdrawn(rig)) is not still_armed


def test_a_vehicle_that_lands_keeps_its_permit():
    rig = permitted()
    rig.fly(5.0, armed=True)
    rig.fly(5.0)
    assert not withdrawn(rig) and rig.reasons() == []


def test_the_uid_is_fixed_by_the_permit():
    rig = Rig(permit=False)
    rig.fly(1.0)
    assert not rig.core.identity.fixed
    permit(rig)
    assert rig.core.identity.fixed


def test_link_that_is_restarted_in_flight_serves_its_vehicle_until_that_is_disarmed():
    rig = Rig(permit=False)
    assert not rig.core.armed(rig.now)
    rig.core.on_request({"do": "was_armed", "vehicle": "uav7"}, rig.now)
    assert rig.core.armed(rig.now + 3600.0), "the vehicle may still fly"
    rig.fly(2.0)
    assert not rig.core.armed(rig.now), "its heartbeat says that it is disarmed"
