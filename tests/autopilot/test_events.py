"""Events of the built-in autopilot: ids, contents, numbers, and repetition on request."""

from __future__ import annotations

import json
import re
import struct

import pytest
from flight import Flight
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot import events
from arena.autopilot.commander import Commander
from arena.autopilot.events import ENUMS, TYPES, Event, event_number
from arena.autopilot.flight_modes import Mode
from arena.autopilot.mavlink.component_files import FILES
from arena.autopilot.mavlink.event_server import CAPACITY, FIRST, EventServer, marked
from arena.wire import px4_messages
from arena.wire.mavlink_frame import SEEDS, pack_frame, parse_frames
from arena.wire.px4_messages import EventRequest

_LAYOUTS = {
    px4_messages.EVENT: struct.Struct("<2IH3B40s"),
    px4_messages.CURRENT_EVENT_SEQUENCE: struct.Struct("<HB"),
    px4_messages.RESPONSE_EVENT_ERROR: struct.Struct("<2H3B"),
}


def fields(message):
    return _LAYOUTS[message.msgid].unpack(message.payload)


def number(message):
    """Return the number of an EVENT."""
    return fields(message)[2]


def server(count: int) -> tuple[EventServer, list[int]]:
    """Return a server that has sent some events, and their numbers."""
    made = EventServer()
    sent = made.send([events.armed("by external command")] * count, 5000)
    return made, [number(m) for m in sent]


# -- ids and contents ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("commander_armed_by", 9489139),
        ("commander_disarmed_by", 16017271),
        ("commander_failsafe_enter", 9751178),
        ("mission_execute", 15598001),
        ("commander_arm_denied_resolve_failures", 133277),
    ],
)
def test_id_is_that_of_px4(name, expected):
    assert event_number(name) == expected
    assert TYPES[name].id == 1 << 24 | expected


def test_every_message_names_its_arguments_only():
    for kind in TYPES.values():
        named = {int(k) for k in re.findall(r"\{(\d+)", kind.message)}
        assert named <= set(range(1, len(kind.arguments) + 1)), kind.name
        assert len(kind(*[0] * len(kind.arguments)).arguments) <= 40


def test_arming_names_its_reason():
    assert events.armed("by stick gesture").arguments == b"\1"
    assert events.disarmed("by landing").arguments == b"\6"
    assert events.disarmed("by a reason without a number").arguments[0] in ENUMS["arm_disarm_reason_t"]


def test_refused_mode_is_named():
    event = events.mode_denied(Mode.MISSION)
    assert struct.unpack("<IB", event.arguments) == (Mode.MISSION.custom_mode, 3)
    assert struct.unpack("<IB", events.mode_denied(None).arguments) == (0, 255)


@pytest.mark.parametrize(
    ("action", "why", "hold_s", "name", "values"),
    [
        (Mode.RTL, "data link lost", None, "commander_failsafe_enter", (6, 2)),
        (Mode.LAND, "battery", 5.2, "commander_failsafe_enter_hold", (7, 5, 0, 4)),
        (Mode.LAND, "geofence", 3.0, "commander_failsafe_enter_generic_hold", (7, 3, 0)),
        (Mode.DESCEND, "no position", None, "commander_failsafe_enter_autopilot_disengaged", (8,)),
        (None, "offboard control lost", None, "commander_failsafe_enter_generic", (9,)),
        (Mode.TERMINATE, "attitude failure", None, "commander_failsafe_enter_generic", (10,)),
    ],
)
def test_failsafe_names_mode_action_delay_and_cause(action, why, hold_s, name, values):
    event = events.failsafe(Mode.OFFBOARD, action, why, hold_s)
    assert event.id == TYPES[name].id
    assert struct.unpack_from("<I", event.arguments) == (Mode.OFFBOARD.custom_mode,)
    assert tuple(event.arguments[4:]) == values


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("hold_s", [None, -1.0, 1e9])
def test_every_failsafe_has_an_event(mode, hold_s):
    assert events.failsafe(mode, mode, "anything", hold_s).id


def test_metadata_describe_every_event():
    content = json.loads(FILES["/etc/extras/all_events.json"])["components"]["1"]
    described = content["event_groups"]["default"]["events"]
    assert {(int(number), d["name"]) for number, d in described.items()} == {
        (event_number(name), name) for name in TYPES
    }
    for kind in TYPES.values():
        types = [a["type"] for a in described[str(event_number(kind.name))].get("arguments", [])]
        assert [t.removeprefix("px4::") for t in types] == list(kind.arguments)
        assert all(t.removeprefix("px4::") in content["enums"] for t in types if t.startswith("px4::"))


def test_component_file_names_the_file_of_the_events():
    general = json.loads(FILES["/etc/extras/component_general.json"])
    (entry,) = [e for e in general["metadataTypes"] if e["type"] == 4]
    assert entry["uri"] == "mftp://etc/extras/all_events.json"
    assert entry["fileCrc"] == px4_messages.px4_crc32(FILES["/etc/extras/all_events.json"])


# -- numbers and requests --------------------------------------------------------------------------------------------


def test_numbering_begins_again_until_the_first_event():
    made = EventServer()
    assert made.newest == ((FIRST - 1) % 65536, px4_messages.SEQUENCE_RESET)
    (message,) = made.send([events.TAKEOFF()], 1234)
    assert fields(message)[:3] == (events.TAKEOFF().id, 1234, FIRST)
    assert made.newest == (FIRST, 0)


def test_numbers_wrap_around():
    assert server(15)[1] == [*range(FIRST, 65536), *range(5)]


def test_kept_event_is_sent_again():
    made = EventServer()
    sent = made.send([events.armed("by external command"), events.TAKEOFF(), events.LANDING()], 7)
    asked = EventRequest(number(sent[1]), number(sent[2]), 1, 1)
    assert made.requested(asked, 255, 190) == sent[1:]


def test_event_that_is_too_old_is_an_error_that_names_the_oldest_one():
    made, numbers = server(CAPACITY + 3)
    (message,) = made.requested(EventRequest(numbers[2], numbers[2], 1, 1), 255, 190)
    assert fields(message) == (numbers[2], numbers[3], 255, 190, 0)
    assert [number(m) for m in made.requested(EventRequest(numbers[3], numbers[3], 1, 1), 255, 190)] == [
        numbers[3]
    ]


def test_request_before_the_first_event_is_an_error():
    (message,) = EventServer().requested(EventRequest(3, 3, 1, 1), 255, 190)
    assert fields(message) == (3, (FIRST - 1) % 65536, 255, 190, 0)


@pytest.mark.parametrize(("first", "last"), [(0, 65535), (10, 9), (FIRST, FIRST - 1)])
def test_number_of_replies_is_limited(first, last):
    assert len(server(5)[0].requested(EventRequest(first, last, 1, 1), 255, 190)) == CAPACITY


def test_only_a_text_that_says_no_more_than_its_event_is_marked():
    commander = Commander("uav1")
    commander.report(6, "Takeoff detected", events.TAKEOFF())
    commander.report(2, "Arming denied: no position", events.ARMING_DENIED())
    commander.report(2, "Reposition rejected")
    assert marked(commander.texts, commander.events) == [
        (6, "Takeoff detected\t"),
        (2, "Arming denied: no position"),
        (2, "Reposition rejected"),
    ]


def test_failsafe_text_is_always_shown():
    assert all(not kind.says_all for name, kind in TYPES.items() if "failsafe" in name)


# -- in flight -------------------------------------------------------------------------------------------------------


def received(data: bytes, msgid: int) -> list[bytes]:
    return [data[f.payload : f.payload + f.size] for f in parse_frames(data).frames if f.msgid == msgid]


@pytest.fixture(scope="module")
def sent() -> tuple[Flight, dict[str, bytes]]:
    """A vehicle that was armed while a ground station listened, and the bytes that it sent on each link."""
    flight = Flight(1)
    interface, data = flight.pilots.interfaces[0], {name: b"" for name in ("router", "ground", "vision")}
    flight.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20)
    for name in data:
        link = interface.links[name]
        take = link.take_datagram

        def keep(name=name, take=take) -> bytes:
            one = take()
            data[name] += one
            return one

        link.take_datagram = keep  # type: ignore[method-assign]
    flight.send(0, mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    flight.command(0, 400, 1)
    flight.run(4.0)
    return flight, data


def test_arming_is_an_event_on_every_link_that_has_a_client(sent):
    _, data = sent
    (message,) = received(data["router"], px4_messages.EVENT)
    assert message[:4] == struct.pack("<I", events.ARMED.id)
    assert received(data["vision"], px4_messages.EVENT) == [message]
    assert received(data["ground"], px4_messages.EVENT) == []  # no client has sent anything there


def test_text_of_the_event_is_marked_for_ground_stations(sent):
    flight, _ = sent
    texts = [m.text for m in flight.received[0] if m.get_type() == "STATUSTEXT"]
    assert "Armed by external command\t" in texts


def test_client_receives_the_event_again_that_it_has_missed(sent):
    flight, data = sent
    (message,) = received(data["router"], px4_messages.EVENT)
    before = len(data["router"])
    own = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    request = pack_frame(412, struct.pack("<2H2B", FIRST, FIRST, 1, 1), own, SEEDS[412])
    flight.pilots.interfaces[0].receive("router", request, flight.now)
    flight.run(0.1)
    assert received(data["router"][before:], px4_messages.EVENT) == [message]


def test_current_sequence_is_the_number_of_the_newest_event(sent):
    flight, data = sent
    flight.run(4.0)
    newest = received(data["router"], px4_messages.CURRENT_EVENT_SEQUENCE)[-1].ljust(3, b"\0")
    assert struct.unpack("<HB", newest) == (FIRST, 0)


def test_event_without_text_stays_an_event():
    assert Event(1, 2).with_text("a text") == Event(1, 2)
