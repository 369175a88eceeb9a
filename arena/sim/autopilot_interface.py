"""Interface between the simulated world and its autopilots. Pure.

Several kinds of autopilots can be combined into one set.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from arena.wire.truth_page import Truth

Array = NDArray[np.float64]
Rows = NDArray[np.intp]


class AutopilotSet(Protocol):
    """Autopilots of all vehicles in a world, for example the built-in ones of `arena.autopilot`."""

    @property
    def armed(self) -> NDArray[np.bool_]:
        """Mask of the armed vehicles (V,)."""
        ...

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        """Pass a received MAVLink datagram to the autopilot of one vehicle.

        link: name of the MAVLink link on which it arrived
        """
        ...

    def sticks(self, vehicle: int, on: bool) -> None:
        """Switch the simulated radio control of a vehicle on or off."""
        ...

    def step(self, now: float, sensors: dict[str, Array]) -> Array:
        """Compute one control step of all autopilots and return the motor commands 0..1 (V, R).

        now: simulation time [s]
        sensors: samples of all sensors, by name
        """
        ...

    def transmit(self) -> list[tuple[int, str, bytes]]:
        """Return the MAVLink datagrams that the autopilots send, as (vehicle index, link name, data)."""
        ...

    def on_request(self, request: Mapping[str, Any]) -> None:
        """Process a request of the supervisor, such as to refuse arming.

        `process_context` explains the requests.
        """
        ...

    def stats(self) -> dict[str, Any]:
        """Return the statistics of all autopilots: vehicle name -> statistics."""
        ...

    def events(self) -> list[str]:
        """Return new log lines about events since the last call."""
        ...


@runtime_checkable
class ExternalAutopilots(Protocol):
    """Autopilots that run in separate processes, such as PX4.

    Each step has two halves, `begin` and `finish`. The world does other work while the autopilots compute.
    Each step calls `receive_truth`, then `begin` with the sensor samples of the same instant, then `finish`.

    requested: names of the sensors that the next `begin` needs and that are sampled on request only
    """

    @property
    def requested(self) -> tuple[str, ...]: ...

    def receive_truth(self, truth: Truth) -> None:
        """Store the current true state of all vehicles. PX4 writes it to its log."""
        ...

    def begin(self, now: float, sensors: dict[str, Array]) -> None:
        """Send the sensor samples of the simulation time `now` [s]. Then the autopilots start to compute."""
        ...

    def finish(self) -> Array:
        """Wait for the motor commands 0..1 and return them (V, R)."""
        ...


MakeAutopilots = Callable[[dict[str, Any], float], AutopilotSet]
"""Function (settings of the world, sensor period [s]) -> the autopilots."""


class CompositeAutopilots:
    """Combination of several kinds of autopilots in one set, such as PX4 and the built-in autopilot.

    Each kind flies some of the vehicles.

    parts: (rows of the world, the autopilots that fly them)
    vehicles, rotors: shape of the motor commands
    """

    def __init__(self, parts: Sequence[tuple[Rows, AutopilotSet]], vehicles: int, rotors: int) -> None:
        self._parts, self._shape = parts, (vehicles, rotors)
        self._external = [a if isinstance(a, ExternalAutopilots) else None for _, a in parts]
        self._by_row = {int(row): (part, i) for rows, part in parts for i, row in enumerate(rows)}

    @property
    def armed(self) -> NDArray[np.bool_]:
        """Mask of the armed vehicles (V,)."""
        found = np.zeros(self._shape[0], bool)
        for rows, part in self._parts:
            found[rows] = part.armed
        return found

    @property
    def requested(self) -> tuple[str, ...]:
        """Names of the sensors, such as GPS, that must be sampled before the next call of `begin`.

        Sensors that are sampled in every step are not listed.
        """
        return tuple({name for part in self._external if part is not None for name in part.requested})

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        """Pass a received MAVLink datagram to the autopilot of one vehicle.

        link: name of the MAVLink link on which it arrived
        """
        part, i = self._by_row[vehicle]
        part.receive(i, link, data)

    def sticks(self, vehicle: int, on: bool) -> None:
        """Switch the simulated radio control of a vehicle on or off."""
        part, i = self._by_row[vehicle]
        part.sticks(i, on)

    def step(self, now: float, sensors: dict[str, Array]) -> Array:
        """Compute one control step of all autopilots and return the motor commands 0..1 (V, R)."""
        self.begin(now, sensors)
        return self.finish()

    def begin(self, now: float, sensors: dict[str, Array]) -> None:
        """Send the sensor samples to external autopilots such as PX4, and store them for the built-in autopilots.

        `finish` runs the control step of the built-in autopilots.
        """
        self._now = now
        self._sensors = [{key: value[rows] for key, value in sensors.items()} for rows, _ in self._parts]
        for external, part in zip(self._external, self._sensors, strict=True):
            if external is not None:
                external.begin(now, part)

    def finish(self) -> Array:
        """Run one control step of the built-in autopilots, and wait for the replies of the external autopilots.

        Return the motor commands of all vehicles, 0..1 (V, R).
        """
        motors = np.zeros(self._shape)
        for (rows, part), external, sensors in zip(self._parts, self._external, self._sensors, strict=True):
            found = part.step(self._now, sensors) if external is None else external.finish()
            motors[rows, : found.shape[1]] = found
        return motors

    def receive_truth(self, truth: Truth) -> None:
        """Pass the true state to the external autopilots, for their logs.

        Each kind of autopilot (PX4 SITL, hardware in the loop) receives only the state of its own vehicles.
        """
        for (rows, _), external in zip(self._parts, self._external, strict=True):
            if external is not None:
                external.receive_truth(
                    Truth(
                        time_s=truth.time_s,
                        p_n=truth.p_n[rows],
                        q_nb=truth.q_nb[rows],
                        v_n=truth.v_n[rows],
                        omega_b=truth.omega_b[rows],
                        accel_b=truth.accel_b[rows],
                        motors=truth.motors[rows],
                    )
                )

    def transmit(self) -> list[tuple[int, str, bytes]]:
        """Return the MAVLink datagrams that the autopilots send, as (vehicle index, link name, data)."""
        return [(int(rows[i]), link, data) for rows, part in self._parts for i, link, data in part.transmit()]

    def on_request(self, request: Mapping[str, Any]) -> None:
        """Pass a request of the supervisor to each kind of autopilot."""
        for _, part in self._parts:
            part.on_request(request)

    def stats(self) -> dict[str, Any]:
        """Return the statistics of all autopilots: vehicle name -> statistics."""
        return {name: figures for _, part in self._parts for name, figures in part.stats().items()}

    def events(self) -> list[str]:
        """Return new log lines about events of all autopilots since the last call."""
        return [text for _, part in self._parts for text in part.events()]

    def close(self) -> None:
        """Close all autopilots that need closing, such as connections to PX4."""
        for _, part in self._parts:
            close: Callable[[], None] | None = getattr(part, "close", None)
            if close is not None:
                close()
