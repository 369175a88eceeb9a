"""Core of the emulated sensors: computes the messages of all sensors from captured frames and telemetry.

Opens no sockets and reads no clock. The process `sensors` and the fused arena use it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from arena.emulated_sensors.sensors import BeaconSensor, NeighbourSensor
from arena.emulated_sensors.settings import Settings, Vehicle
from arena.emulated_sensors.states import States
from arena.mocap.client import CapturedFrame
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import SENSORS_COMPONENT
from arena.wire.relative_measurements import DEBUG_FLOAT_ARRAY, Measurement, measurement_payload


@dataclass(frozen=True, kw_only=True)
class _Carrier:
    """Vehicle that has emulated sensors.

    row: index of the vehicle.
    """

    row: int
    codec: Codec
    neighbours: NeighbourSensor | None
    beacons: BeaconSensor | None


class EmulatedSensors:
    """Emulated relative sensors of all vehicles.

    sent: number of measurements of each vehicle, by name.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._states = States(settings)
        self._carriers = [
            _carrier(row, v, settings) for row, v in enumerate(settings.vehicles) if v.router is not None
        ]
        self.sent = {settings.vehicles[c.row].name: 0 for c in self._carriers}

    def on_frame(self, frame: CapturedFrame, simulated: bool, now: float) -> None:
        """Store the captured poses of a frame.

        simulated: True for a frame of the motion-capture emulator.  now: time of arrival [s].
        """
        self._states.captured.on_frame(frame, simulated, now)

    def on_datagram(self, row: int, data: bytes, now: float) -> None:
        """Store the position, velocity and attitude that an autopilot has estimated, from its datagram.

        row: index of the vehicle.  now: time of arrival [s].
        """
        if self.settings.vehicles[row].estimated:
            self._states.estimated.on_datagram(row, data, now)

    def step(self, now: float) -> list[tuple[int, bytes]]:
        """Return the messages of all sensors that measure now, as (index of the vehicle, datagram).

        now: [s].
        """
        found = []
        for carrier in self._carriers:
            measured = self._measure(carrier, now)
            if measured:
                self.sent[self.settings.vehicles[carrier.row].name] += len(measured)
                found.append(
                    (
                        carrier.row,
                        b"".join(
                            carrier.codec.frame(DEBUG_FLOAT_ARRAY, measurement_payload(m)) for m in measured
                        ),
                    )
                )
        return found

    def stats(self) -> dict[str, Any]:
        """Return the numbers of sent measurements and of unused poses, for the statistics of the process."""
        refused = {f"dropped {why}": n for why, n in self._states.captured.counts.items()}
        return {**{f"{name} measurements": n for name, n in self.sent.items()}, **refused}

    def _measure(self, carrier: _Carrier, now: float) -> list[Measurement]:
        found: list[Measurement] = []
        near, beacons, get = carrier.neighbours, carrier.beacons, self._states.get
        if near is not None and near.timer.is_due(now):
            source = near.settings.source
            others = [get(source, row, now) for row in near.settings.rows]
            found += near.measure(get(source, carrier.row, now), others)
        if beacons is not None and beacons.timer.is_due(now):
            found += beacons.measure(get(beacons.settings.source, carrier.row, now))
        return found


def _carrier(row: int, v: Vehicle, settings: Settings) -> _Carrier:
    near = v.neighbours
    ids = [settings.vehicles[other].id for other in near.rows] if near is not None else []
    return _Carrier(
        row=row,
        codec=Codec(v.id, SENSORS_COMPONENT),
        neighbours=None if near is None else NeighbourSensor(near, ids, settings.seed, v.id),
        beacons=None if v.beacons is None else BeaconSensor(v.beacons, settings.seed, v.id),
    )
