"""Live view for Foxglove: a flight with viewers is the flight without them, also if one viewer hangs."""

from __future__ import annotations

import functools
import json
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from foxglove_clients import Client, LiveMessage, hung_client
from viewer_records import decoded

from arena.flight_log.recording import Recording

from .flight import Flight, Hangar, arena_yaml, eventually

pytestmark = pytest.mark.flight
PORT = 8765
RAW = ("/uav1/mavlink/down", "/uav1/mavlink/up", "/uav1/truth", "/mocap/frames")
WATCHED = ("/uav1/local_position", "/uav1/estimate/pose")


def up(hangar: Hangar, folder: Path, *options: str) -> Flight:
    """Start a flight of one vehicle, as fast as possible."""
    yaml = arena_yaml(folder, hangar.address, {"uav1": "land"})
    return hangar.up(yaml, "--speed", "max", "--until-done", "--no-report", "--seed", "3", *options)


@pytest.fixture(scope="module")
def watched(
    shared_hangar: Hangar, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Flight, list[LiveMessage]]:
    """Fly with two viewers: one reads, and the other has subscribed to all topics advertised so far and reads nothing."""
    flight = up(shared_hangar, tmp_path_factory.mktemp("watched"), "--foxglove")
    eventually(lambda: "live view" in flight.said(), 60, "the live view", flight.said)
    with closing(Client(flight.address, PORT)) as client:
        client.subscribe(*WATCHED)
        with closing(hung_client(flight.address, PORT, client.topics.values())):
            found = [message for message in client.received(60.0) if message.topic]
        assert flight.wait(240) == 0, flight.said()
    return flight, found


def test_flight_with_viewers_equals_the_flight_without(watched, shared_hangar, tmp_path):
    alone = up(shared_hangar, tmp_path)
    assert alone.wait(240) == 0, alone.said()
    records = [Recording(flight.folder / "flight.mcap") for flight in (watched[0], alone)]
    for topic in RAW:
        live, without = (list(record.messages((topic,))) for record in records)
        assert len(live) > 100 and live == without, topic


def test_viewer_receives_what_is_recorded(watched):
    flight, found = watched
    record = Recording(flight.folder / "flight.mcap")
    recorded = {(topic, round(time_s * 1e9), data) for topic, time_s, data in record.messages(WATCHED)}
    assert {topic for topic, _, _ in found} == set(WATCHED)
    assert set(found) <= recorded
    assert len(found) > len(recorded) / 2


def test_layouts_of_the_run_fit_its_record(watched):
    flight, _ = watched
    newest = {
        topic: got[-1][1] for topic, got in decoded((flight.folder / "flight.mcap").read_bytes()).items()
    }
    config: dict[str, Any] = json.loads((flight.folder / "flight.foxglove.json").read_text())["configById"]
    paths = [p["value"] for panel in config.values() for p in panel.get("paths", ())]
    assert len(paths) > 25
    for path in paths:
        topic, *fields = path.split(".")
        assert isinstance(functools.reduce(getattr, fields, newest[topic]), (float, str)), path
    assert "uav1 control" in (flight.folder / "flight.plotjuggler.xml").read_text()
