"""Writes the MAVLink messages of a vehicle as a telemetry log (.tlog).

QGroundControl, Mission Planner and MAVExplorer open this format. A tlog contains MAVLink frames, each after a
time stamp of 8 bytes: Unix time in microseconds, big endian.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from arena.flight_log.recording import Recording
from arena.wire.flight_record import SIMULATION_CLOCK, down_topic, up_topic
from arena.wire.mavlink_frame import parse_frames

_STAMP = struct.Struct(">Q")


def write_tlogs(folder: Path, recording: Recording, vehicles: Sequence[str]) -> dict[Path, int]:
    """Write all MAVLink frames from and to each vehicle to `<folder>/<vehicle>.tlog`.

    Return path -> number of frames. The times of a simulated flight begin at the Unix time of its start.
    """
    simulated = recording.clock == SIMULATION_CLOCK
    shift_s = recording.start_unix_s - recording.start_s if simulated else 0.0
    written = {folder / f"{vehicle}.tlog": 0 for vehicle in vehicles}
    paths = {topic: path for path in written for topic in (down_topic(path.stem), up_topic(path.stem))}
    with ExitStack() as stack:
        files = {path: stack.enter_context(path.open("wb")) for path in written}
        for topic, time_s, data in recording.messages(paths.keys()):
            stamp, path = _STAMP.pack(round(1e6 * (time_s + shift_s))), paths[topic]
            frames = parse_frames(data).frames
            files[path].write(b"".join([stamp + data[frame.start : frame.end] for frame in frames]))
            written[path] += len(frames)
    return written
