"""Computes the logs (`Flight`) of all vehicles from a recorded flight, the file `flight.mcap`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from arena.flight_log.flight import Flight
from arena.flight_log.recording import RecordedVehicle, Recording, later_parts
from arena.flight_log.vehicle_record import VehicleRecord
from arena.flight_log.vehicle_rows import make_flight_of
from arena.wire.flight_record import FRAMES_TOPIC, down_topic, truth_topic, unpack_frame, up_topic

ROW_HZ = 30.0
"""Rows per second of the log of a vehicle without recorded true states, if nothing else is given."""
_BYTES_AT_ONCE = 200_000_000  # of the file: its data need about twice as much memory


def flights_of(
    recording: Recording, row_hz: float = ROW_HZ, ulogs: Mapping[str, Sequence[Path]] | None = None
) -> Iterator[Flight]:
    """Yield the log of each vehicle of a recording, in the order of the arena's vehicles.

    A vehicle without a recorded message has no log.

    row_hz: rows per second of a vehicle without true states. A simulated vehicle has one row per recorded true state.
    ulogs: vehicle -> logs that its autopilot has written (ULog). They contain quantities that no MAVLink message has.
    """
    size = sum(path.stat().st_size for path in (recording.path, *later_parts(recording.path)))
    count = len(recording.vehicles)
    at_once = max(1, math.floor(count * _BYTES_AT_ONCE / max(size, 1)))
    for first in range(0, count, at_once):
        records = read_vehicles(recording, recording.vehicles[first : first + at_once])
        while records:
            record = records.pop(0)  # its memory is free when its log is made
            flight = make_flight_of(record, row_hz, (ulogs or {}).get(record.vehicle.name, ()))
            if flight is not None:
                yield flight


def read_vehicles(recording: Recording, vehicles: Sequence[RecordedVehicle]) -> list[VehicleRecord]:
    """Return the recorded messages, poses and true states of the given vehicles.

    The file is read once for all vehicles.
    """
    records = [VehicleRecord(vehicle) for vehicle in vehicles]
    by_topic = {
        topic: receive
        for record in records
        for topic, receive in (
            (down_topic(record.vehicle.name), record.add_down),
            (up_topic(record.vehicle.name), record.add_up),
            (truth_topic(record.vehicle.name), record.add_truth),
        )
    }
    for topic, time_s, data in recording.messages({FRAMES_TOPIC, *by_topic}):
        receive = by_topic.get(topic)
        if receive is not None:
            receive(time_s, data)
        else:
            frame = unpack_frame(time_s, data)
            bodies = {body.name: body for body in frame.bodies if body.tracked}
            for record in records:
                body = bodies.get(record.vehicle.body)
                if body is not None and frame.simulated == record.vehicle.simulated:
                    record.add_pose(time_s, frame.exposed_s, (*body.q_nb, *body.p_n))
    return records
