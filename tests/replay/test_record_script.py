"""Tests of the script of a record: all messages, each at its time, in order."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from arena.errors import InputError
from arena.flight_log.recording import RecordedMessage, Recording
from arena.mocap.client import CapturedFrame, Pose
from arena.recorder.channels import RawChannels, Recorded
from arena.recorder.mcap_file import McapFile
from arena.replay.record_script import RecordScript, in_order
from arena.replay.script import Item, Kind, RecordedLine, TrueState
from arena.wire.flight_record import METADATA, RecordedFrame, RecordedVehicle, pack_metadata
from arena.wire.truth_page import Truth
from tests.replay.scripts import MS, heartbeat

import numpy as np  # isort: skip

VEHICLES = [
    RecordedVehicle(name="uav1", id=1, body="uav1", simulated=True, autopilot="builtin", profile="iris"),
    RecordedVehicle(name="uav2", id=2, body="drone", simulated=False, autopilot="hardware", profile="aero"),
]


def truth(x: float) -> Truth:
    zero = np.zeros((1, 3))
    return Truth(
        time_s=0.0,
        p_n=np.array([[x, 2.0, -3.0]]),
        q_nb=np.array([[1.0, 0.0, 0.0, 0.0]]),
        v_n=zero + 0.5,
        omega_b=zero + 0.25,
        accel_b=zero,
        motors=np.zeros((1, 4)),
    )


@pytest.fixture
def record(tmp_path: Path) -> Path:
    """A record of 0.1 s with a message of each kind, of which the event was logged late."""
    metadata = pack_metadata(
        name="lab", clock="unix", start_s=7.0, start_unix_s=7.0, size_m=(7.0, 4.0, 3.0), vehicles=VEHICLES
    )
    file = McapFile(tmp_path / "flight.mcap", METADATA, metadata)
    known = [Recorded(name=v.name, id=v.id, body=v.body, index=0 if v.simulated else None) for v in VEHICLES]
    channels = RawChannels(known, file.channel)
    channels.on_datagrams([("uav1", False, heartbeat(1), 7.0)])
    channels.on_datagrams([("uav2", True, b"up", 7.02)])
    pose = Pose("uav1", (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0))
    channels.on_frame(CapturedFrame(41, 7.03, (pose,), ("wand",), 7.035), True, 7.04)
    channels.on_truth(truth(1.0), 7.05)
    channels.on_datagrams([("uav2", False, heartbeat(2), 7.1)])
    line = {"process": "uav1", "event": "took off"}
    channels.on_event(json.dumps(line).encode(), line, 7.03)
    assert file.close()
    return tmp_path / "flight.mcap"


def test_every_message_has_its_time_kind_and_content(record: Path) -> None:
    script = RecordScript(Recording(record))
    items = list(script.items(0))
    assert [(i.kind, i.vehicle, i.time_ns) for i in items] == [
        (Kind.DOWN, 0, 7000 * MS),
        (Kind.UP, 1, 7020 * MS),
        (Kind.EVENT, -1, 7030 * MS),
        (Kind.FRAME, -1, 7040 * MS),
        (Kind.TRUTH, 0, 7050 * MS),
        (Kind.DOWN, 1, 7100 * MS),
    ]
    assert items[0].payload == heartbeat(1)
    assert items[1].payload == b"up"
    assert isinstance(items[2].payload, RecordedLine) and items[2].payload.fields["event"] == "took off"
    frame, state = items[3].payload, items[4].payload
    assert isinstance(frame, RecordedFrame) and isinstance(state, TrueState)
    assert (frame.number, frame.exposed_s, frame.sent_s, frame.simulated) == (41, 7.03, 7.035, True)
    assert [(b.name, b.tracked) for b in frame.bodies] == [("uav1", True), ("wand", False)]
    assert state.p_n == (1.0, 2.0, -3.0)
    assert state.omega_b == (0.25, 0.25, 0.25)


def test_event_at_the_end_of_the_file_is_sent_at_its_time(tmp_path: Path) -> None:
    """In a fast simulation, the recorder reads an event from the disk when many seconds of the flight are already in the file."""
    metadata = pack_metadata(
        name="lab",
        clock="simulation",
        start_s=0.0,
        start_unix_s=0.0,
        size_m=(7.0, 4.0, 3.0),
        vehicles=VEHICLES,
    )
    file = McapFile(tmp_path / "flight.mcap", METADATA, metadata)
    known = [Recorded(name=v.name, id=v.id, body=v.body, index=0 if v.simulated else None) for v in VEHICLES]
    channels = RawChannels(known, file.channel)
    for second in range(20):
        channels.on_datagrams([("uav1", False, heartbeat(1), float(second))])
    line = {"process": "uav1", "event": "took off"}
    channels.on_event(json.dumps(line).encode(), line, 2.5)
    assert file.close()
    items = list(RecordScript(Recording(tmp_path / "flight.mcap")).items(0))
    assert [(i.kind, i.time_ns) for i in items[2:5]] == [
        (Kind.DOWN, 2000 * MS),
        (Kind.EVENT, 2500 * MS),
        (Kind.DOWN, 3000 * MS),
    ]


def test_vehicles_bodies_and_times_are_known_before_the_first_message(record: Path) -> None:
    script = RecordScript(Recording(record))
    assert [(v.name, v.id, v.body, v.simulated) for v in script.vehicles] == [
        ("uav1", 1, "uav1", True),
        ("uav2", 2, "drone", False),
    ]
    assert script.bodies == {"uav1", "wand"}
    assert (script.start_ns, script.end_ns) == (7000 * MS, 7100 * MS)


def test_reading_begins_at_the_requested_time(record: Path) -> None:
    items: list[Item] = list(RecordScript(Recording(record)).items(7040 * MS))
    assert [i.kind for i in items] == [Kind.FRAME, Kind.TRUTH, Kind.DOWN]


def test_record_without_messages_is_refused(tmp_path: Path) -> None:
    metadata = pack_metadata(
        name="lab",
        clock="simulation",
        start_s=0.0,
        start_unix_s=0.0,
        size_m=(7.0, 4.0, 3.0),
        vehicles=VEHICLES,
    )
    file = McapFile(tmp_path / "flight.mcap", METADATA, metadata)
    assert file.close()
    with pytest.raises(InputError, match="no messages"):
        RecordScript(Recording(tmp_path / "flight.mcap"))


def test_messages_of_one_topic_keep_their_order() -> None:
    messages = [RecordedMessage("a", t, b"%d" % k) for k, t in enumerate((1.0, 1.2, 1.1, 5.0, 9.0))]
    messages.insert(4, RecordedMessage("b", 4.5, b"late"))
    found = [(t, m.data) for t, m in in_order(messages)]
    assert [data for _, data in found] == [b"0", b"1", b"2", b"late", b"3", b"4"]
    assert [t for t, _ in found] == sorted(t for t, _ in found)
