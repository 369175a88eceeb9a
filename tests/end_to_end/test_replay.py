"""A flight, its replay, and the record of the replay: equal, message for message. Nothing of a replay leaves this computer."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import psutil
import pytest

from arena.flight_log.recording import Recording
from arena.live_view import LiveFeed
from arena.live_view.fleet import STALE_S
from arena.supervisor import Control, open_run
from arena.wire.telemetry import Telemetry

from .flight import PATIENCE, PROGRAMS, Flight, Hangar, eventually, started_by

pytestmark = pytest.mark.flight
VEHICLES = {"uav1": "lands", "uav2": "lands"}
Messages = dict[str, list[tuple[float, bytes]]]


@pytest.fixture(scope="module")
def flight(shared_hangar: Hangar) -> Flight:
    made = shared_hangar.fly(VEHICLES, "--speed", "max", "--until-done", "--time-limit", "300")
    assert made.wait(360) == 0, made.said()
    return made


def messages(run: Path) -> Messages:
    """Return topic -> (time [s], bytes) of all messages in the record of a run."""
    found: Messages = defaultdict(list)
    for topic, time_s, data in Recording(run / "flight.mcap").messages():
        found[topic].append((time_s, data))
    return found


def replayed(flight: Flight, *options: str) -> Path:
    """Replay a flight to its end. Return the run folder of the replay."""
    folder = flight.runs.parent / "replays"
    before = set(folder.glob("*"))
    done = flight.cli(
        "replay", str(flight.folder), "--headless", "--runs", str(folder), *options, limit_s=200.0
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (made,) = set(folder.glob("*")) - before
    return made


def raw(recorded: Messages) -> Messages:
    """Return the messages of the raw channels: those that are received, not computed from others."""
    ends = ("/mavlink/down", "/mavlink/up", "/truth", "/mocap/frames", "/events")
    return {topic: found for topic, found in recorded.items() if topic.endswith(ends)}


def test_record_of_a_replay_equals_the_record_of_the_flight(flight: Flight) -> None:
    first, second = raw(messages(flight.folder)), raw(messages(replayed(flight, "--speed", "max")))
    assert first.keys() == second.keys()
    assert sum(map(len, first.values())) > 5000
    for topic, sent in first.items():
        assert [data for _, data in second[topic]] == [data for _, data in sent], topic
        late_s = np.abs(np.array([t for t, _ in second[topic]]) - np.array([t for t, _ in sent]))
        assert np.percentile(late_s, 99.0) < 0.002, topic
        assert late_s.max() < 1e-6, topic


@pytest.fixture(scope="module")
def running(flight: Flight) -> Iterator[Path]:
    """A replay in the background that begins paused, 4 s after the start of the flight."""
    folder = flight.runs.parent / "running"
    options = ("--from", "4", "--pause", "--stay", "--speed", "4", "--detach", "--runs", str(folder))
    try:
        made = flight.cli("replay", str(flight.folder), *options)
        assert made.returncode == 0, made.stdout + made.stderr
        (run,) = folder.glob("*")
        yield run
    finally:
        for left in folder.glob("*"):
            flight.cli("down", "--run", str(left))
            for pid in started_by(left):
                os.kill(pid, signal.SIGKILL)


def ask(run: Path, **request: object) -> dict[str, object]:
    state = open_run(run)
    assert state is not None
    return Control(Path(state.rt, "control.sock")).ask(**request)


def test_state_in_a_paused_replay_does_not_become_old(running: Path) -> None:
    with closing(LiveFeed(running)) as feed:

        def silent_s() -> float:
            shown = feed.poll(time.monotonic())
            return math.inf if shown is None else float(shown.fleet.silent_s.max())

        def is_received() -> bool:
            ask(running, do="replay", seek_s=5.0)  # until the router knows this viewer
            return silent_s() < 1.0

        eventually(is_received, 10, "the telemetry after a jump")
        end = time.monotonic() + STALE_S + 1.0
        while time.monotonic() < end:
            assert silent_s() < 1.0
            time.sleep(0.05)


def test_program_reads_the_recorded_telemetry_and_cannot_command(flight: Flight, running: Path) -> None:
    program = subprocess.Popen(
        [sys.executable, str(PROGRAMS / "reads.py"), "--uav", str(running / "slices" / "program.uav1.json")],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert program.stdout is not None
    try:
        # The replay begins when the program has started. On a slow computer it would else be over before.
        assert program.stdout.readline() == "waiting\n"
        ask(running, do="replay", seek_s=4.0, speed=4.0, pause=False)
        said, _ = program.communicate(timeout=PATIENCE * 60.0)
    finally:
        program.kill()
    lines = [line.split() for line in said.splitlines()]
    read = [list(map(float, words[2:])) for words in lines if words[0] == "at"]
    assert len(read) == 40
    recorded = recorded_positions(flight, "uav1").tolist()
    places = [recorded.index(pos) for pos in read]
    assert places == sorted(places)
    assert len(set(places)) > 30
    assert any(line.startswith("refused:") for line in said.splitlines()), said
    eventually(
        lambda: "This is a replay" in (running / "events.jsonl").read_text(), 10, "the refusal is reported"
    )


def recorded_positions(flight: Flight, vehicle: str) -> np.ndarray:
    """Return the estimated positions of a recorded vehicle, in the order of recording [m] [NED] (n, 3)."""
    telemetry, positions = Telemetry(1), []
    for datagram in Recording(flight.folder / "flight.mcap").datagrams(vehicle):
        if not datagram.up:
            telemetry.on_datagram(datagram.data, datagram.time_s)
            if telemetry.local is not None and telemetry.local.received_at == datagram.time_s:
                positions.append(telemetry.local.pos)
    return np.array(positions)


def test_running_replay_reaches_this_computer_only_and_says_what_it_is(flight: Flight, running: Path) -> None:
    state = open_run(running)
    assert state is not None
    process = psutil.Process(state.processes["replay"].pid)
    own = [c for c in process.net_connections("inet")]
    assert own and all(c.laddr.ip.startswith("127.") for c in own)
    assert not [file for file in process.open_files() if file.path.startswith("/dev/tty")]
    assert "replayed" in flight.cli("ps", "--run", str(running)).stdout

    began = time.monotonic()
    landed = flight.cli("land-all", "--run", str(running), "--timeout", "600")
    assert landed.returncode == 0
    assert "is a replay" in landed.stdout
    assert time.monotonic() - began < 300, "it does not wait for a landing"


def test_running_replay_can_be_paused_and_moved(running: Path) -> None:
    def stats() -> dict[str, object]:
        return ask(running, do="view")["processes"]["replay"]["stats"]  # type: ignore[index]

    ask(running, do="replay", pause=True, seek_s=2.5)
    eventually(lambda: stats()["time_s"] == 2.5, 10, "the place after the jump", stats)
    ask(running, do="replay", pause=False, speed="max")
    end = stats()["duration_s"]
    eventually(lambda: math.isclose(stats()["time_s"], end), 60, "the end of the record", stats)  # type: ignore[arg-type]
    ask(running, do="replay", seek_s=1.0, pause=True)
    eventually(lambda: stats()["time_s"] == 1.0, 10, "the place after the jump back", stats)
