"""Routes: which client receives which message, and which vehicle which command."""

import dataclasses

import pytest
from fleet import (
    GCS,
    LAND,
    RECORDER,
    TOOL,
    Fleet,
    ack,
    attitude,
    command,
    heartbeat,
    landed_state,
    packed,
    slice_of,
    timesync,
)
from pymavlink.dialects.v20 import common as mavlink

from arena.errors import InputError
from arena.mavlink_router.endpoints import MAX_TOOLS
from arena.mavlink_router.router import MAX_SENDERS, TOOL_TIMEOUT_S, Router
from arena.mavlink_router.routing_table import Table

PROGRAM1, PROGRAM2, GCS_ID = (1, 191), (2, 191), (255, 190)


@pytest.fixture
def fleet():
    return Fleet()


def test_a_stream_reaches_the_vehicles_clients_and_all_ground_stations(fleet):
    data = attitude(1)
    assert fleet.send_as("autopilot1", data) == {
        name: data for name in ("program1", "sdk1", "recorder", "gcs")
    }
    assert set(fleet.send_as("autopilot2", attitude(2))) == {"program2", "sdk2", "recorder", "gcs"}


def test_a_programs_command_reaches_its_own_vehicle_only(fleet):
    data = command(1, PROGRAM1)
    assert fleet.send_as("program1", data) == {"autopilot1": data}


def test_a_program_cannot_command_another_vehicle(fleet):
    assert fleet.send_as("program1", command(2, PROGRAM1)) == {}
    assert fleet.dropped == {"target is not a vehicle of this client": 1}


def test_a_programs_broadcast_stays_with_its_vehicle(fleet):
    assert set(fleet.send_as("program1", command(0, PROGRAM1))) == {"autopilot1"}
    assert set(fleet.send_as("program1", heartbeat(*PROGRAM1, kind=18))) == {"autopilot1"}


def test_ground_station_of_a_replay_may_send_from_its_second_address_only(fleet):
    settings, second = slice_of((1,)), ("127.0.0.1", 14550)
    (station,) = settings["gcs"]
    for also, passed in ((second, True), (None, False)):
        own = {**station, "also_from": also} if also else station
        router = Router(Table.from_slice({**settings, "gcs": [own]}))
        socket = router.sockets.index(router.table.gcs_local)
        assert bool(router.on_datagram(socket, second, command(1, GCS_ID), 0.0)) is passed
        assert not router.on_datagram(socket, ("127.0.0.1", 14551), command(1, GCS_ID), 0.0)


def test_a_ground_station_commands_the_vehicle_it_names_or_all(fleet):
    assert set(fleet.send_as("gcs", command(2, GCS_ID))) == {"autopilot2"}
    assert set(fleet.send_as("gcs", command(0, GCS_ID))) == {"autopilot1", "autopilot2"}
    assert fleet.send_as("gcs", command(9, GCS_ID)) == {}
    assert fleet.dropped == {"target is not a vehicle of this client": 1}


def test_a_datagram_for_two_vehicles_is_split_between_frames(fleet):
    a, b, c = command(1, GCS_ID), command(1, (255, 191)), command(2, GCS_ID)
    assert fleet.send_as("gcs", a + b + c + a) == {"autopilot1": a + b + a, "autopilot2": c}
    out = fleet.router.on_datagram(fleet.socket(fleet.table.gcs_local), GCS, a + b + c, 0.0)
    assert [len(piece) for piece, _ in out] == [len(a + b), len(c)]


def test_an_acknowledgement_goes_to_the_commander_and_the_recorder(fleet):
    fleet.send_as("program1", heartbeat(*PROGRAM1))
    fleet.send_as("gcs", heartbeat(*GCS_ID))
    assert set(fleet.send_as("autopilot1", ack(PROGRAM1))) == {"program1", "recorder"}
    assert set(fleet.send_as("autopilot1", ack(GCS_ID))) == {"gcs", "recorder"}
    assert set(fleet.send_as("autopilot1", ack((1, 77)))) == {"recorder"}


def test_a_target_without_component_reaches_all_components(fleet):
    fleet.send_as("program1", heartbeat(*PROGRAM1))
    fleet.send_as("sdk1", heartbeat(1, 192))
    assert set(fleet.send_as("autopilot1", ack((1, 0)))) == {"program1", "sdk1", "recorder"}


def test_a_client_is_answered_from_its_first_message_on(fleet):
    assert set(fleet.send_as("autopilot1", ack(PROGRAM1))) == {"recorder"}
    fleet.send_as("program1", command(1, PROGRAM1))
    assert set(fleet.send_as("autopilot1", ack(PROGRAM1))) == {"program1", "recorder"}


def test_a_foreign_system_on_a_vehicles_link_is_not_forwarded(fleet):
    mixed = attitude(2) + attitude(1) + attitude(3)
    assert fleet.send_as("autopilot1", mixed)["program1"] == attitude(1)
    assert fleet.dropped == {"foreign system on a vehicle's link": 2}


def test_other_components_of_the_vehicle_are_forwarded(fleet):
    assert "program1" in fleet.send_as("autopilot1", attitude(1, component=100))


def test_a_vehicles_messages_do_not_return_to_it_through_a_client(fleet):
    """A second router on a client's port would otherwise make a loop."""
    assert fleet.send_as("program1", attitude(1)) == {}
    assert fleet.send_as("gcs", attitude(2)) == {}
    assert fleet.dropped == {"a vehicle's message, returned by a client": 2}


def test_timesync_requests_reach_a_vehicle_and_replies_do_not(fleet):
    assert fleet.send_as("program1", timesync(0)) != {}
    for who, speaker in (("program1", PROGRAM1), ("gcs", GCS_ID)):
        assert fleet.send_as(who, timesync(1, *speaker)) == {}
    assert fleet.tool(timesync(1 << 60, 1, 192)) == {}
    assert fleet.dropped == {"TIMESYNC reply": 3}


def test_a_timesync_reply_between_commands_is_removed(fleet):
    a, b = command(1, PROGRAM1), heartbeat(*PROGRAM1, kind=18)
    assert fleet.send_as("program1", a + timesync(7) + b) == {"autopilot1": a + b}


@pytest.mark.parametrize("socket", ["local", "serve"])
def test_an_unknown_sender_is_refused_on_links_and_client_sockets(fleet, socket):
    address = getattr(fleet.vehicle(1), socket)
    assert fleet.send(TOOL, address, attitude(1)) == {}
    assert sum(fleet.dropped.values()) == 1


def test_an_unknown_sender_cannot_use_the_ground_stations_socket(fleet):
    assert fleet.send(TOOL, fleet.table.gcs_local, command(1, GCS_ID)) == {}
    assert fleet.send_as("program2", command(1, PROGRAM1), at=fleet.vehicle(1).serve) == {}


def test_a_local_tool_is_answered_for_ten_seconds(fleet):
    asker = (253, 195)
    assert set(fleet.tool(command(1, asker))) == {"autopilot1"}
    assert set(fleet.send_as("autopilot1", ack(asker))) == {"tool", "recorder"}
    assert "tool" in fleet.send_as("autopilot1", attitude(1))
    assert "tool" not in fleet.send_as("autopilot2", attitude(2))
    fleet.now += TOOL_TIMEOUT_S - 0.1
    fleet.router.tick(fleet.now)
    assert "tool" in fleet.send_as("autopilot1", attitude(1))
    fleet.now += 0.2
    fleet.router.tick(fleet.now)
    assert "tool" not in fleet.send_as("autopilot1", attitude(1))


def test_a_tool_on_another_computer_is_refused(fleet):
    assert fleet.tool(command(1, (253, 195)), address=("192.0.2.7", 5000)) == {}
    assert fleet.dropped == {"tool on another computer": 1}


def test_a_new_tool_replaces_the_one_silent_for_longest(fleet):
    for i in range(3 * MAX_TOOLS):
        sender = ("127.0.0.1", 30000 + i)
        fleet.names[sender] = f"t{i}"
        assert set(fleet.tool(command(1, (253, 190)), address=sender)) == {"autopilot1"}
        assert f"t{i}" in fleet.send_as("autopilot1", attitude(1))
    assert sum(name.startswith("t") for name in fleet.send_as("autopilot1", attitude(1))) == MAX_TOOLS


def test_garbage_does_not_make_a_tool(fleet):
    assert fleet.tool(b"\xfdnot a frame") == {}
    assert "tool" not in fleet.send_as("autopilot1", attitude(1))
    assert fleet.dropped == {"garbage bytes": 12}


def test_the_senders_of_an_endpoint_are_bounded(fleet):
    for system in range(3, 250):
        fleet.send_as("program1", heartbeat(system, 191))
    assert set(fleet.send_as("autopilot1", ack((249, 191)))) == {"program1", "recorder"}
    assert set(fleet.send_as("autopilot1", ack((249 - MAX_SENDERS, 191)))) == {"recorder"}


def test_messages_without_a_receiver_are_counted(fleet):
    v = fleet.vehicle(1)
    router = Router(dataclasses.replace(fleet.table, vehicles=(v,), recorder=None))
    assert router.on_datagram(router.sockets.index(v.local), v.remote, ack((9, 9)), 0.0) == []
    assert router.counts.dropped == {"no receiver": 1}


def test_many_frames_leave_in_datagrams_that_fit_ethernet(fleet):
    a = command(1, PROGRAM1)
    socket = fleet.socket(fleet.vehicle(1).serve)
    out = fleet.router.on_datagram(socket, fleet.address["program1"], a * 100, 0.0)
    assert b"".join(bytes(piece) for piece, _ in out) == a * 100
    assert max(len(piece) for piece, _ in out) <= 1472


def test_frames_and_bytes_are_counted_each_way(fleet):
    fleet.send_as("autopilot1", attitude(1) * 3)
    fleet.send_as("program1", command(1, PROGRAM1))
    counts = fleet.router.counts
    assert (counts.frames_from_vehicles, counts.frames_to_clients) == (3, 12)
    assert (counts.frames_from_clients, counts.frames_to_vehicles) == (1, 1)
    assert counts.bytes_in == len(attitude(1) * 3 + command(1, PROGRAM1))


def test_a_fact_is_reported_once_when_it_changes(fleet):
    assert not fleet.router.all_connected
    fleet.send_as("autopilot1", heartbeat(1, armed=True))
    assert fleet.router.changed_facts() == {
        "uav1.connected": True,
        "uav1.armed": True,
        "uav1.mode": "OFFBOARD",
    }
    fleet.send_as("autopilot1", heartbeat(1, armed=True))
    assert fleet.router.changed_facts() == {}
    assert fleet.router.armed(simulated=True)
    fleet.send_as("autopilot1", heartbeat(1, mode=LAND))
    assert fleet.router.changed_facts() == {"uav1.armed": False, "uav1.mode": "AUTO.LAND"}
    assert not fleet.router.armed(simulated=True)
    fleet.send_as("autopilot2", heartbeat(2))
    assert fleet.router.all_connected


def test_a_real_vehicle_that_is_switched_off_is_not_waited_for():
    fleet = Fleet(real=(2,))
    fleet.send_as("autopilot1", heartbeat(1))
    assert fleet.router.all_connected
    fleet.send_as("autopilot2", heartbeat(2, armed=True))
    assert fleet.router.changed_facts()["uav2.armed"] is True
    assert (fleet.router.armed(simulated=True), fleet.router.armed(simulated=False)) == ([], ["uav2"])
    assert Fleet(real=(1, 2)).router.all_connected


def test_the_time_in_the_air_is_reported_at_take_off_and_landing(fleet):
    fleet.send_as("autopilot1", landed_state(1))
    assert fleet.router.changed_facts() == {"uav1.landed": True}
    fleet.send_as("autopilot1", landed_state(3))
    assert fleet.router.changed_facts() == {"uav1.landed": False, "uav1.airborne_s": 0.0}
    fleet.now += 4.5
    for state in (2, 4):
        fleet.send_as("autopilot1", landed_state(state))
    assert fleet.router.changed_facts() == {}
    fleet.send_as("autopilot1", landed_state(0))
    assert fleet.router.changed_facts() == {}
    fleet.send_as("autopilot1", landed_state(1))
    assert fleet.router.changed_facts() == {"uav1.landed": True, "uav1.airborne_s": 4.5}


def test_a_silent_vehicle_is_disconnected_and_keeps_its_last_armed(fleet):
    fleet.send_as("autopilot1", heartbeat(1, armed=True))
    fleet.router.changed_facts()
    fleet.now += 2.9
    fleet.router.tick(fleet.now)
    assert fleet.router.changed_facts() == {}
    fleet.now += 0.2
    fleet.router.tick(fleet.now)
    assert fleet.router.changed_facts() == {"uav1.connected": False}
    assert fleet.router.armed(simulated=True)


@pytest.mark.parametrize("data", [heartbeat(1, 191, armed=True), heartbeat(2, 1, armed=True)])
def test_only_the_autopilots_own_heartbeat_counts(fleet, data):
    fleet.send_as("autopilot1", data)
    fleet.send_as("program1", data)
    assert fleet.router.changed_facts() == {}


def test_a_ground_station_is_alive_for_three_seconds_after_a_real_frame(fleet):
    fleet.send_as("gcs", b"\xfd" * 50)
    assert not fleet.router.gcs_alive(fleet.now)
    fleet.send_as("gcs", heartbeat(*GCS_ID))
    assert fleet.router.gcs_alive(fleet.now + 2.9)
    assert not fleet.router.gcs_alive(fleet.now + 3.1)


def test_the_routers_heartbeat_goes_to_every_vehicle(fleet):
    out = fleet.router.heartbeat(b"beat")
    [(frame, destinations)] = out
    assert frame == b"beat"
    names = [fleet.names[dest] for _, dest in destinations]
    assert names == ["autopilot1", "recorder", "autopilot2", "recorder"]
    assert [fleet.router.sockets[key] for key, dest in destinations if dest != RECORDER] == [
        fleet.vehicle(1).local,
        fleet.vehicle(2).local,
    ]


def test_vehicle_with_a_data_link_failsafe_needs_an_operator_for_the_heartbeat():  # review fault 20
    fleet = Fleet(real=(2,), needs_operator=(2,))
    ((_, destinations),) = fleet.router.heartbeat(b"beat", operator=False)
    assert [fleet.names[dest] for _, dest in destinations] == ["autopilot1", "recorder"]
    ((_, destinations),) = fleet.router.heartbeat(b"beat", operator=True)
    names = [fleet.names[dest] for _, dest in destinations]
    assert names == ["autopilot1", "recorder", "autopilot2", "recorder"]


@pytest.mark.parametrize("shortcut", [True, False])
def test_program_cannot_send_the_heartbeat_of_a_ground_station(shortcut):
    """MAVSDK sends this heartbeat. The failsafe `data_link_loss` must act although such a program still runs."""
    fleet = Fleet(real=(2,), needs_operator=(2,), use_shortcut=shortcut)
    as_station, as_computer = heartbeat(245, 190, kind=6), heartbeat(245, 190, kind=18)
    for _ in range(2):
        assert "autopilot2" not in fleet.send_as("sdk2", as_station)
        assert "autopilot2" not in fleet.tool(as_station, 2)
        assert fleet.send_as("sdk2", as_computer)["autopilot2"] == as_computer
        assert fleet.send_as("sdk1", as_station)["autopilot1"] == as_station
    assert fleet.send_as("gcs", heartbeat(255, 190, kind=6)).keys() == {"autopilot1", "autopilot2"}
    assert fleet.dropped == {"a program's heartbeat as a ground station": 4}
    assert "sdk2" in fleet.send_as("autopilot2", ack((245, 190), 2))  # the program still gets its replies


def test_a_client_on_another_computer_has_a_socket_that_can_reach_it():
    """A socket bound to loopback cannot: the kernel refuses to send."""
    far = ("192.0.2.7", 14550)
    router = Router(Table.from_slice(slice_of((1,), gcs=far)))
    [(_, destinations)] = router.on_datagram(
        router.sockets.index(("127.54.0.1", 24011)), ("127.54.0.1", 24010), attitude(1), 0.0
    )
    served = {dest: router.sockets[key][0] for key, dest in destinations}
    assert served.pop(far) == "0.0.0.0"
    assert set(served.values()) == {"127.54.0.1"}
    wide = router.sockets.index(("0.0.0.0", 0))
    assert router.on_datagram(wide, far, command(1, GCS_ID), 0.0)
    assert router.on_datagram(wide, ("192.0.2.8", 14550), command(1, GCS_ID), 0.0) == []


def test_a_manual_control_goes_to_the_vehicle_it_names(fleet):
    sticks = packed(mavlink.MAVLink_manual_control_message(2, 1, 2, 3, 4, 5), *GCS_ID)
    assert set(fleet.send_as("gcs", sticks)) == {"autopilot2"}


def test_an_incomplete_slice_is_refused_with_the_missing_key():
    with pytest.raises(InputError, match="gcs_local"):
        Table.from_slice({"vehicles": []})


def test_a_host_name_is_refused():
    with pytest.raises(InputError, match="numeric"):
        Table.from_slice(slice_of(gcs=("laptop", 14550)))


def copies(fleet, socket, sender, data):
    """Return [(socket, bytes)] that the recorder receives when a datagram arrives."""
    out = fleet.router.on_datagram(fleet.socket(socket), sender, data, fleet.now)
    return [
        (fleet.router.sockets[key], bytes(piece))
        for piece, places in out
        for key, to in places
        if to == RECORDER
    ]


@pytest.fixture(params=[True, False], ids=["shortcut", "no shortcut"])
def recorded(request):
    fleet = Fleet()
    fleet.router.use_shortcut = request.param
    return fleet


def test_recorder_gets_telemetry_from_the_address_for_programs(recorded):
    v = recorded.vehicle(2)
    for _ in range(3):
        assert copies(recorded, v.local, v.remote, attitude(2)) == [(v.serve, attitude(2))]
    assert copies(recorded, v.local, v.remote, ack(PROGRAM1, 2)) == [(v.serve, ack(PROGRAM1, 2))]


def test_recorder_gets_what_is_sent_to_a_vehicle_from_its_address_for_tools(recorded):
    v = recorded.vehicle(1)
    program = v.clients[0]
    for data in (command(1, PROGRAM1), command(1, PROGRAM1), heartbeat(*PROGRAM1, kind=18)):
        assert copies(recorded, v.serve, program, data) == [(v.tools, data)]
    assert copies(recorded, v.tools, TOOL, command(1, (253, 190))) == [(v.tools, command(1, (253, 190)))]


def test_recorder_gets_a_broadcast_once_per_vehicle(recorded):
    data = command(0, GCS_ID)
    assert copies(recorded, recorded.table.gcs_local, GCS, data) == [
        (recorded.vehicle(1).tools, data),
        (recorded.vehicle(2).tools, data),
    ]


def test_recorder_gets_the_heartbeat_of_the_router(recorded):
    ((_, places),) = recorded.router.heartbeat(heartbeat(254, 190, kind=6))
    to_recorder = [recorded.router.sockets[key] for key, to in places if to == RECORDER]
    assert to_recorder == [recorded.vehicle(1).tools, recorded.vehicle(2).tools]


def test_recorder_does_not_get_what_the_router_drops(recorded):
    v = recorded.vehicle(1)
    for data in (command(2, PROGRAM1), timesync(5), b"noise"):
        assert copies(recorded, v.serve, v.clients[0], data) == []


def test_copies_for_the_recorder_are_not_frames_to_vehicles(recorded):
    for _ in range(3):
        recorded.send_as("program1", attitude(*PROGRAM1))
    recorded.send_as("gcs", command(0, GCS_ID))
    assert recorded.router.counts.frames_to_vehicles == 5
