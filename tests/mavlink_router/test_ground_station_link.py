"""The link for ground stations: what passes on it, and that no command bypasses the authority."""

import pytest
from fleet import (
    LAND,
    OFFBOARD,
    RECORDER,
    TOOL,
    Fleet,
    ack,
    attitude,
    command,
    heartbeat,
    landed_state,
    packed,
)
from pymavlink.dialects.v20 import common as mavlink

from arena.mavlink_router.link_impairment import ImpairedRouter

PROGRAM1, STATION = (1, 191), (255, 190)


@pytest.fixture(params=[False, True], ids=["python", "shortcut"])
def fleet(request):
    """Return a router with vehicle 1, which has a ground station link, and vehicle 2, which has none."""
    return Fleet(ground=(1,), use_shortcut=request.param)


def land_mode(sender, target):
    message = mavlink.MAVLink_command_long_message(target, 1, 176, 0, 1, 4, 6, 0, 0, 0, 0)
    return packed(message, *sender)


def test_streams_of_the_ground_station_link_reach_ground_stations_only(fleet):
    for _ in range(2):  # the second datagram takes the shortcut
        assert set(fleet.send_as("ground1", attitude(1))) == {"gcs"}


def test_streams_of_the_router_link_do_not_reach_ground_stations_as_well(fleet):
    fleet.tool(heartbeat(*STATION))
    for _ in range(2):
        assert set(fleet.send_as("autopilot1", attitude(1))) == {"program1", "sdk1", "tool", "recorder"}
    assert "gcs" in fleet.send_as("autopilot2", attitude(2)), "vehicle 2 has one link for everything"


def test_request_of_a_ground_station_is_sent_once_on_its_own_link(fleet):
    assert set(fleet.send_as("gcs", command(1, STATION))) == {"ground1"}
    assert set(fleet.send_as("gcs", command(2, STATION))) == {"autopilot2"}
    assert set(fleet.send_as("gcs", heartbeat(*STATION))) == {"ground1", "autopilot2"}


def test_request_of_a_program_does_not_enter_the_ground_station_link(fleet):
    for who, data in (("program1", command(1, PROGRAM1)), ("sdk1", heartbeat(245, 190))):
        assert set(fleet.send_as(who, data)) == {"autopilot1"}
    assert set(fleet.tool(land_mode((253, 195), 1))) == {"autopilot1"}


def test_reply_reaches_the_ground_station_once_and_the_record(fleet):
    fleet.send_as("gcs", command(1, STATION))
    fleet.send_as("program1", command(1, STATION))  # a program with the system id of a ground station
    assert fleet.send_as("ground1", ack(STATION)) == {"gcs": ack(STATION), "recorder": ack(STATION)}
    assert set(fleet.send_as("autopilot1", ack(STATION))) == {"program1", "recorder"}


def test_streams_of_the_ground_station_link_are_not_recorded_twice(fleet):
    assert "recorder" not in fleet.send_as("ground1", attitude(1) + heartbeat(1) + landed_state(1))


def test_command_of_a_ground_station_is_recorded_as_sent_to_the_vehicle(fleet):
    v = fleet.vehicle(1)
    out = fleet.router.on_datagram(
        fleet.socket(fleet.table.gcs_local), fleet.address["gcs"], command(1, STATION), fleet.now
    )
    (places,) = [places for _, places in out]
    assert sorted(places) == sorted(
        [(fleet.socket(v.ground.local), v.ground.remote), (fleet.socket(v.tools), RECORDER)]
    )
    assert fleet.router.counts.frames_to_vehicles == 1


def test_refused_command_of_a_ground_station_reaches_no_link(fleet):
    """After land-all nobody arms the vehicle: neither by its id, nor by a broadcast, nor by the id of land-all."""
    fleet.send_as("program1", command(1, PROGRAM1))
    fleet.send_as("autopilot1", heartbeat(1, armed=True))
    fleet.tool(land_mode((253, 195), 1))
    fleet.now += 1.0
    for data in (command(1, STATION), command(1, (253, 195)), command(1, (1, 191))):
        assert set(fleet.send_as("gcs", data)) == {"gcs"}
    assert not {"ground1", "autopilot1"} & set(fleet.send_as("gcs", command(0, STATION)))
    assert set(fleet.send_as("gcs", land_mode(STATION, 1))) == {"ground1"}, "landing is always allowed"


def test_refused_command_stops_no_other_frame_of_its_datagram(fleet):
    fleet.send_as("autopilot1", heartbeat(1, armed=True))
    fleet.tool(land_mode((253, 195), 1))
    beat = heartbeat(*STATION)
    received = fleet.send_as("gcs", beat + command(1, STATION) + land_mode(STATION, 1))
    assert received["ground1"] == beat + land_mode(STATION, 1)


@pytest.mark.parametrize("sender", ["program1", "sdk1", "gcs"])
def test_only_the_autopilot_sends_on_its_ground_station_link(fleet, sender):
    local = fleet.vehicle(1).ground.local
    assert fleet.send(fleet.address[sender], local, command(1, STATION) + attitude(1)) == {}
    assert fleet.send(TOOL, local, land_mode((253, 195), 1)) == {}
    assert fleet.dropped == {"unknown sender on a vehicle's link": 2}


def test_frames_of_another_vehicle_do_not_pass_the_ground_station_link(fleet):
    for _ in range(2):
        assert fleet.send_as("ground1", attitude(2)) == {}
    assert fleet.send_as("ground1", attitude(2) + attitude(1)) == {"gcs": attitude(1)}


def test_status_of_the_vehicle_comes_from_the_router_link(fleet):
    """A datagram on the ground station link cannot change who may command the vehicle."""
    fleet.send_as("autopilot1", heartbeat(1, armed=True, mode=OFFBOARD))
    fleet.router.changed_facts()
    fleet.send_as("ground1", heartbeat(1, armed=False, mode=LAND) + landed_state(1))
    assert fleet.router.changed_facts() == {} and fleet.router.armed(simulated=True) == ["uav1"]


def test_routers_heartbeat_enters_the_link_once_a_station_was_received(fleet):
    beat = heartbeat(254, 190)
    assert set(fleet.named(fleet.router.heartbeat(beat))) - {"recorder"} == {"autopilot1", "autopilot2"}
    fleet.send_as("gcs", heartbeat(*STATION))
    found = set(fleet.named(fleet.router.heartbeat(beat))) - {"recorder"}
    assert found == {"autopilot1", "autopilot2", "ground1"}


def test_new_ground_station_program_changes_the_receivers_of_replies(fleet):
    fleet.send_as("gcs", command(1, STATION))
    assert set(fleet.send_as("ground1", ack((77, 1)))) == {"recorder"}
    fleet.send_as("gcs", heartbeat(77, 1))
    assert set(fleet.send_as("ground1", ack((77, 1)))) == {"gcs", "recorder"}


def test_injected_loss_and_delay_act_on_both_links_of_a_vehicle(fleet):
    impaired = ImpairedRouter(fleet.router)
    impaired.apply({"do": "loss", "vehicle": "uav1", "share": 1.0})
    v, gcs = fleet.vehicle(1), fleet.socket(fleet.table.gcs_local)
    for local, remote in ((v.local, v.remote), (v.ground.local, v.ground.remote)):
        assert impaired.on_datagram(fleet.socket(local), remote, attitude(1), 1.0, 1.0) == []
    out = impaired.on_datagram(gcs, fleet.address["gcs"], command(1, STATION), 1.0, 1.0)
    assert "ground1" not in fleet.named(out)
    impaired.clear()
    impaired.apply({"do": "delay", "vehicle": "uav1", "ms": 100.0})
    assert impaired.on_datagram(fleet.socket(v.ground.local), v.ground.remote, attitude(1), 2.0, 2.0) == []
    assert set(fleet.named(impaired.release(2.2, 2.2))) == {"gcs"}
