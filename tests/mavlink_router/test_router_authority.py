"""Authority at the router: which sender may command a vehicle."""

import pytest
from fleet import LAND, OFFBOARD, Fleet, ack, command, heartbeat, packed
from pymavlink.dialects.v20 import common as mavlink

from arena.authority import Role
from arena.mavlink_router.router import Router
from arena.wire.mavlink_codec import Codec

PROGRAM, SDK, LAND_ALL, COPILOT, GROUND_STATION = (1, 191), (245, 190), (253, 195), (251, 190), (255, 190)
POSCTL, HOLD = 3 << 16, 4 << 16 | 3 << 24
READER = Codec(1, 191)


def set_mode(mode, sender=PROGRAM, target=1):
    message = mavlink.MAVLink_command_long_message(
        target, 1, 176, 0, 1, mode >> 16 & 0xFF, mode >> 24, 0, 0, 0, 0
    )
    return packed(message, *sender)


def setpoint(sender=PROGRAM, target=1):
    return packed(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, target, 1, 1, 3576, 0, 0, -1, 0, 0, 0, 0, 0, 0, 0, 0
        ),
        *sender,
    )


def texts(data):
    return [m.text for m in READER.parse(data) if m.get_type() == "STATUSTEXT"]


@pytest.fixture(params=[(), (1,)], ids=["one link", "ground station link"])
def fleet(request):
    """Return a router with the simulated vehicle 1 and the real vehicle 2, which their programs fly in OFFBOARD.

    Both links of a vehicle with a ground station link are called "autopilot1": a command may not pass on either of them.
    """
    fleet = Fleet(real=(2,), ground=request.param)
    fleet.names |= {v.ground.remote: f"autopilot{v.id}" for v in fleet.table.vehicles if v.ground}
    for k in (1, 2):
        fleet.send_as(f"program{k}", set_mode(OFFBOARD, (k, 191), k) + command(k, (k, 191)))
        fleet.send_as(f"autopilot{k}", heartbeat(k, armed=True))
    fleet.router.commands.changes()
    return fleet


def land_all(fleet, k=1):
    return fleet.tool(set_mode(LAND, LAND_ALL, k), k)


@pytest.mark.parametrize(
    ("number", "params"),
    [
        (176, (4, 4, 6)),
        (176, (1, 4, 5.6)),
        (176, (1, 4, -250)),
        (186, (20, 0)),
        (189, ()),
        (84, ()),
        (23, ()),
    ],
    ids=["base mode", "fraction", "no byte", "CHANGE_ALTITUDE", "LAND_START", "VTOL_TAKEOFF", "PRECLAND"],
)
@pytest.mark.parametrize("sender", [PROGRAM, GROUND_STATION])
def test_no_command_ends_a_landing_of_land_all(fleet, sender, number, params):
    """PX4 obeys each of these commands: it leaves AUTO.LAND or climbs."""
    land_all(fleet)
    numbers = (*params, *(0,) * (7 - len(params)))
    message = mavlink.MAVLink_command_long_message(1, 1, number, 0, *numbers)
    name = "program1" if sender == PROGRAM else "gcs"
    assert "autopilot1" not in fleet.send_as(name, packed(message, *sender))


def test_refused_command_is_answered_and_not_forwarded(fleet):  # review fault 9
    land_all(fleet)
    received = fleet.send_as("program1", set_mode(OFFBOARD))
    assert set(received) == {"program1"}
    text, answer = READER.parse(received["program1"])
    assert text.text == "land-all has control: run `arena release`"
    assert (answer.command, answer.result) == (176, mavlink.MAV_RESULT_DENIED)
    assert (answer.get_srcSystem(), answer.get_srcComponent()) == (1, 1)
    assert (answer.target_system, answer.target_component) == PROGRAM


def test_the_reason_of_a_refusal_is_sent_at_most_twice_a_second(fleet):
    land_all(fleet)
    found = []
    for _ in range(20):
        fleet.now += 0.1
        found += texts(fleet.send_as("program1", set_mode(OFFBOARD))["program1"])
    assert len(found) == 4


def test_refused_command_does_not_stop_others_of_its_datagram(fleet):
    land_all(fleet)
    ping = heartbeat(*PROGRAM, kind=18)
    received = fleet.send_as("program1", ping + set_mode(OFFBOARD) + set_mode(LAND))
    assert received["autopilot1"] == ping + set_mode(LAND)


@pytest.mark.parametrize("sender", [LAND_ALL, COPILOT])
def test_programs_fly_on_only_after_release(fleet, sender):
    fleet.tool(set_mode(LAND, sender))
    for who, message in (
        ("program1", setpoint()),
        ("sdk1", set_mode(OFFBOARD, SDK)),
        ("program1", command(1, PROGRAM)),
        ("gcs", command(1, GROUND_STATION)),
    ):
        assert "autopilot1" not in fleet.send_as(who, message)
    assert fleet.send_as("program2", setpoint((2, 191), 2)) != {}
    fleet.router.commands.on_request({"do": "release", "vehicle": "uav1", "by": "ada"}, fleet.now)
    assert "autopilot1" in fleet.send_as("program1", set_mode(OFFBOARD))


def test_programs_do_not_retake_offboard_from_a_ground_station(fleet):  # review fault 9
    assert "autopilot1" in fleet.send_as("gcs", set_mode(HOLD, GROUND_STATION))
    fleet.send_as("autopilot1", heartbeat(1, armed=True, mode=HOLD))
    received = fleet.send_as("program1", set_mode(OFFBOARD))
    assert texts(received["program1"]) == ["ground station took control: run `arena release`"]
    assert set(fleet.send_as("sdk1", set_mode(OFFBOARD, SDK))) == {"sdk1"}


def test_copilot_and_land_all_do_not_pass_while_the_pilot_has_control(fleet):  # review fault 5
    fleet.send_as("autopilot2", heartbeat(2, armed=True, mode=POSCTL))
    for sender in (COPILOT, LAND_ALL):
        assert set(fleet.tool(set_mode(LAND, sender, 2), 2)) == {"tool"}
    assert set(fleet.send_as("gcs", set_mode(LAND, GROUND_STATION, 2))) == {"autopilot2"}


def test_system_id_of_a_client_does_not_give_it_a_higher_role(fleet):
    land_all(fleet)
    assert "autopilot1" not in fleet.send_as("program1", set_mode(OFFBOARD, LAND_ALL))
    assert "autopilot1" not in fleet.send_as("gcs", command(1, LAND_ALL))


def test_broadcast_reaches_the_vehicles_that_its_sender_may_command(fleet):
    land_all(fleet)
    fleet.now += 5.0
    received = fleet.send_as("gcs", setpoint(GROUND_STATION, 0))
    assert set(received) == {"autopilot2"}
    assert set(fleet.send_as("gcs", heartbeat(*GROUND_STATION, kind=6))) == {"autopilot1", "autopilot2"}


@pytest.mark.parametrize("who", ["program1", "gcs"])
def test_nobody_arms_once_the_run_ends(who):  # review fault 6
    fleet = Fleet()
    fleet.router.commands.on_request({"do": "refuse_arming", "why": "the run is ending"}, 0.0)
    sender = PROGRAM if who == "program1" else GROUND_STATION
    assert texts(fleet.send_as(who, command(1, sender))[who]) == ["arming refused: the run is ending"]
    assert set(fleet.send_as(who, set_mode(LAND, sender))) == {"autopilot1"}


def test_changes_of_authority_are_events_of_simulated_vehicles(fleet):
    land_all(fleet)
    land_all(fleet, 2)  # the hardware link reports this one
    events, facts = fleet.router.commands.changes()
    assert events == ["uav1: land-all has control: landing, until `arena release`"]
    latched = "land-all has control"
    standing = {"latch": [Role.EMERGENCY, 3]}
    assert facts.pop("uav1.standing") == facts.pop("uav2.standing") == standing
    assert facts == {"uav1.control": "land-all", "uav1.blocked": latched, "uav2.blocked": latched}
    fleet.send_as("autopilot1", heartbeat(1, mode=LAND))
    assert fleet.router.commands.changes() == (["uav1: disarmed"], {"uav1.control": ""})
    fleet.router.commands.on_request({"do": "release", "vehicle": "uav1", "by": "ada"}, fleet.now)
    assert fleet.router.commands.changes() == (
        ["uav1: released by ada"],
        {"uav1.blocked": "", "uav1.standing": {}},
    )


def test_hold_of_the_copilot_lasts_by_simulation_time(fleet):
    sim = [10.0]
    fleet.router = Router(fleet.table, lambda: sim[0])
    fleet.tool(set_mode(HOLD, COPILOT))
    fleet.now += 60.0  # a slow simulation
    sim[0] += 0.9
    assert "autopilot1" not in fleet.send_as("program1", set_mode(OFFBOARD))
    sim[0] += 0.2
    assert "autopilot1" in fleet.send_as("program1", set_mode(OFFBOARD))


def test_reply_of_the_autopilot_still_reaches_the_refused_client(fleet):
    land_all(fleet)
    fleet.send_as("program1", set_mode(OFFBOARD))
    assert "program1" in fleet.send_as("autopilot1", ack(PROGRAM))
