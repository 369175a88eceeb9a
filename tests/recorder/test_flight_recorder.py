"""Core of the recorder: what reaches the file, what is reported, and which failures end what."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from recorded_flights import OFFBOARD, STEPS, stream, truth_at

from arena.flight_log.recording import Recording
from arena.mocap.client import CapturedFrame, Pose
from arena.process_context import ProcessContext
from arena.recorder import mcap_file
from arena.recorder.channels import Datagram, RawChannels
from arena.recorder.flight_recorder import SILENT_S, FlightRecorder

SETTINGS: dict[str, Any] = {
    "name": "recorder",
    "arena": "lab",
    "size_m": [8.0, 6.0, 3.0],
    "clock": "clock",
    "vehicles": [
        {"name": "uav1", "id": 1, "body": "b1", "index": 0, "autopilot": "builtin", "profile": "iris"},
        {"name": "uav2", "id": 2, "body": "b2", "index": None, "autopilot": "hardware", "profile": "big"},
    ],
}


class Process(ProcessContext):
    """Process whose packets to the supervisor are kept."""

    def __init__(self, folder: Path, **more: Any) -> None:
        super().__init__("recorder", {**SETTINGS, "folder": str(folder), **more}, None)
        self.packets: list[dict[str, Any]] = []

    def send(self, packet: dict[str, Any]) -> bool:
        self.packets.append(packet)
        return True

    @property
    def events(self) -> list[str]:
        return [p["event"] for p in self.packets if "event" in p]

    @property
    def last_stats(self) -> dict[str, Any]:
        return [p["stats"] for p in self.packets if "stats" in p][-1]


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end, "the condition did not become true"
        time.sleep(0.001)


def message(armed: bool = True, landed: bool = True) -> bytes:
    return stream(1.0, np.zeros(3), STEPS[0], OFFBOARD, armed, landed)


def test_metadata_and_all_data_are_in_the_file(tmp_path):
    recorder = FlightRecorder(Process(tmp_path), 2.5)
    recorder.on_datagrams([("uav1", False, message(), 3.0)])
    recorder.on_datagrams([("uav2", True, b"up", 3.1)])
    pose = Pose("b1", (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0))
    recorder.on_frame(CapturedFrame(number=1, time_s=2.9, poses=(pose,), untracked=("b2",)), True, 3.2)
    recorder.on_truth(truth_at(np.array([0.0, 0.0, -0.05]), np.zeros(3)), 3.3)
    recorder.close(4.0)
    record = Recording(tmp_path / "flight.mcap")
    assert (record.name, record.clock, record.start_s) == ("lab", "simulation", 2.5)
    assert abs(record.start_unix_s - time.time()) < 60.0
    assert [(v.name, v.simulated, v.autopilot) for v in record.vehicles] == [
        ("uav1", True, "builtin"),
        ("uav2", False, "hardware"),
    ]
    assert [tuple(m) for m in record.messages(("/uav1/mavlink/down", "/uav2/mavlink/up"))] == [
        ("/uav1/mavlink/down", 3.0, message()),
        ("/uav2/mavlink/up", 3.1, b"up"),
    ]
    assert [body.name for frame in record.frames() for body in frame.bodies] == ["b1", "b2"]
    assert record.truth("uav1").t.tolist() == [3.3]


def test_no_vehicle_counts_as_armed_after_a_minute_without_a_datagram(tmp_path):
    """The router may have died with its supervisor: then nobody reports the disarming, and the recorder must end."""
    recorder = FlightRecorder(Process(tmp_path), 0.0)
    recorder.on_datagrams([("uav1", False, message(armed=True), 1.0)])
    found = []
    for at in (100.0, 100.0 + SILENT_S - 1.0, 100.0 + SILENT_S + 1.0):
        recorder.tick(1.0, at)
        found.append(recorder.armed)
    assert found == [["uav1"], ["uav1"], []]
    recorder.on_datagrams([("uav1", False, message(armed=True), 2.0)])
    recorder.tick(2.0, 100.0 + SILENT_S + 2.0)
    assert recorder.armed == ["uav1"]
    recorder.close(3.0)


def test_event_is_not_recorded_before_the_line_above_it(tmp_path, monkeypatch):
    """The supervisor writes times of the start of its loop beside present times, so a line can have an earlier time."""
    recorder, began = FlightRecorder(Process(tmp_path), 0.0), time.monotonic()
    times = [began + 0.9, began + 0.1, began + 0.95]
    lines = [{"mono": at, "process": "arena", "event": f"event {i}"} for i, at in enumerate(times)]
    (tmp_path / "events.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    monkeypatch.setattr(time, "monotonic", lambda: began + 1.0)
    recorder.close(10.0)
    events = list(Recording(tmp_path / "flight.mcap").events())
    assert [event.text for event in events] == ["event 0", "event 1", "event 2"]
    assert [round(event.time_s, 1) for event in events] == [9.0, 9.0, 9.5]


def test_events_of_the_run_are_recorded_at_their_time(tmp_path):
    recorder, began = FlightRecorder(Process(tmp_path), 0.0), time.monotonic()
    lines = [{"mono": began + 0.1 * i, "process": "arena", "event": f"event {i}"} for i in range(3)]
    (tmp_path / "events.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines) + "broken\n")
    recorder.tick(0.0, began)
    recorder.close(10.0)
    events = list(Recording(tmp_path / "flight.mcap").events())
    assert [event.text for event in events] == ["event 0", "event 1", "event 2"]
    assert all(0.0 <= event.time_s <= 10.0 for event in events)


def test_take_off_is_reported_once_by_the_true_height(tmp_path):
    process = Process(tmp_path)
    recorder = FlightRecorder(process, 0.0)
    for height in (0.05, 0.06, 0.2, 0.5):
        recorder.on_truth(truth_at(np.array([0.0, 0.0, -height]), np.zeros(3)), height)
    recorder.close(1.0)
    assert process.events == ["uav1: airborne"]
    assert abs(process.last_stats["vehicles"]["uav1"]["airborne_unix_s"] - time.time()) < 60.0
    assert "airborne_unix_s" not in process.last_stats["vehicles"]["uav2"]


def test_armed_vehicles_are_those_of_the_last_heartbeats(tmp_path):
    recorder = FlightRecorder(Process(tmp_path), 0.0)
    assert recorder.armed == []
    recorder.on_datagrams([("uav1", False, message(armed=True), 1.0)])
    assert recorder.armed == ["uav1"]
    recorder.on_datagrams([("uav1", False, message(armed=False), 2.0)])
    assert recorder.armed == []
    recorder.close(3.0)


def test_full_disk_is_reported_once_and_ends_only_the_record(tmp_path, monkeypatch):
    def full(fd: int, data: bytes) -> None:
        raise OSError(28, "No space left on device")

    process = Process(tmp_path)
    recorder = FlightRecorder(process, 0.0)
    monkeypatch.setattr(mcap_file, "write_all", full)
    for i in range(5):
        recorder.on_datagrams([("uav1", False, message(), 1.0 * i)])
        recorder.tick(1.0 * i, 1.0 * i)
        wait_for(lambda: not recorder._file.busy)
    recorder.close(6.0)
    (event,) = process.events
    assert "the record of the flight has ended" in event
    assert "No space left on device" in event
    assert process.last_stats["record"] == "No space left on device"
    assert process.last_stats["vehicles"]["uav1"]["datagrams_hz"] > 0


def test_error_of_the_mcap_writer_ends_the_record_not_the_flight(tmp_path, monkeypatch):
    def broken(*piece: object) -> bytes:
        raise RuntimeError("broken")

    monkeypatch.setattr(mcap_file, "plain_chunk", broken)
    process = Process(tmp_path)
    recorder = FlightRecorder(process, 0.0)
    recorder.on_datagrams([("uav1", False, message(), 0.5)])
    recorder.tick(1.0, 1.0)
    recorder.on_datagrams([("uav1", False, message(), 1.5)])
    recorder.close(2.0)
    (event,) = process.events
    assert "the record of the flight has ended" in event and "broken" in event


def test_record_whose_raw_channels_have_failed_is_not_called_complete(tmp_path):
    process = Process(tmp_path)
    recorder = FlightRecorder(process, 0.0)
    recorder.on_datagrams([("uav1", False, b"x", float("nan"))])  # no time
    recorder.on_datagrams([("uav1", False, b"x", 1.0)])
    recorder.close(2.0)
    assert process.last_stats["record"] != "complete"
    assert any("RawChannels has failed" in event for event in process.events)


def test_raw_channels_only_get_datagrams_while_the_recorder_is_behind(tmp_path):
    class Viewers:
        count = 0

        def on_datagrams(self, datagrams: list[Datagram]) -> None:
            self.count += len(datagrams)

    process, viewers = Process(tmp_path), Viewers()
    recorder = FlightRecorder(
        process, 0.0, lambda settings, vehicles, channel: [RawChannels(vehicles, channel), viewers]
    )
    for i in range(6):
        recorder.behind = i in (1, 2, 3, 4)
        recorder.on_datagrams([("uav1", False, b"x", 1.0 * i)])
    recorder.close(6.0)
    assert viewers.count == 2
    assert process.last_stats["not_for_viewers"] == 4
    assert len(list(Recording(tmp_path / "flight.mcap").datagrams("uav1"))) == 6


def test_output_that_fails_within_a_batch_leaves_the_batch_to_the_others(tmp_path):
    class Broken:
        def on_datagrams(self, datagrams: list[Datagram]) -> None:
            assert [vehicle for vehicle, *_ in datagrams] == ["uav1", "uav2", "uav1"]
            raise ValueError("broken")

    process = Process(tmp_path)
    recorder = FlightRecorder(
        process, 0.0, lambda settings, vehicles, channel: [Broken(), RawChannels(vehicles, channel)]
    )
    batch = [
        ("uav1", False, message(armed=True), 1.0),
        ("uav2", True, b"up", 1.0),
        ("uav1", False, b"x", 1.1),
    ]
    recorder.on_datagrams(batch)
    assert recorder.armed == ["uav1"]
    recorder.close(2.0)
    recording = Recording(tmp_path / "flight.mcap")
    found = {name: [(d.up, d.data) for d in recording.datagrams(name)] for name in ("uav1", "uav2")}
    assert found == {"uav1": [(False, batch[0][2]), (False, b"x")], "uav2": [(True, b"up")]}


def test_failure_of_other_channels_does_not_end_the_record(tmp_path):
    class Broken:
        def on_datagrams(self, datagrams: list[Datagram]) -> None:
            raise ValueError("broken")

        on_frame = on_truth = on_event = on_datagrams

    process = Process(tmp_path)
    recorder = FlightRecorder(
        process, 0.0, lambda settings, vehicles, channel: [Broken(), RawChannels(vehicles, channel)]
    )
    for i in range(3):
        recorder.on_datagrams([("uav1", False, b"x", 1.0 * i)])
    recorder.close(3.0)
    assert process.events == [
        "recorder: the output Broken has failed and writes no more data: ValueError('broken')",
    ]
    assert len(list(Recording(tmp_path / "flight.mcap").datagrams("uav1"))) == 3
