"""The world's interface to autopilots, and several kinds of autopilots behind one. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from arena.wire.truth_page import Truth

Array = NDArray[np.float64]
Rows = NDArray[np.intp]


class AutopilotSet(Protocol):
    """The autopilots of all vehicles in a world, such as the built-in ones of `arena.autopilot`."""

    @property
    def armed(self) -> NDArray[np.bool_]:
        """True for each armed vehicle (V,)."""
        ...

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        """Process a datagram that arrived on one of a vehicle's MAVLink links."""
        ...

    def sticks(self, vehicle: int, on: bool) -> None:
        """Switch a pilot's radio control on or off."""
        ...

    def step(self, now: float, sensors: dict[str, Array]) -> Array:
        """Return motor commands 0..1 (V, R) for the sensor samples at a simulation time [s]."""
        ...

    def transmit(self) -> list[tuple[int, str, bytes]]:
        """Return the datagrams to send: (vehicle, link, data)."""
        ...

    def stats(self) -> dict[str, Any]:
        """Return figures of each vehicle for the process's stats, by name."""
        ...

    def events(self) -> list[str]:
        """Return the events since the last call, one line each."""
        ...


@runtime_checkable
class ExternalAutopilots(Protocol):
    """Autopilots in processes of their own: their step has two halves, and the world does other work in between.

    Each step: `receive_truth`, then `begin` with the sensor samples of the same instant, then `finish`.
    requested: sensors that `begin` needs and that are sampled on request only
    """

    @property
    def requested(self) -> tuple[str, ...]: ...

    def receive_truth(self, truth: Truth) -> None:
        """Take the true state now."""
        ...

    def begin(self, now: float, sensors: dict[str, Array]) -> None:
        """Send the sensor samples at a simulation time [s]; the autopilots compute from here on."""
        ...

    def finish(self) -> Array:
        """Wait for the motor commands and return them, 0..1 (V, R)."""
        ...


MakeAutopilots = Callable[[dict[str, Any], float], AutopilotSet]
"""(world slice, sensor period [s]) -> the autopilots."""


class CompositeAutopilots:
    """Several kinds of autopilots that look like one set: each flies its own rows of the world.

    parts: (rows of the world, the autopilots that fly them)
    vehicles, rotors: shape of the motor commands
    """

    def __init__(self, parts: Sequence[tuple[Rows, AutopilotSet]], vehicles: int, rotors: int) -> None:
        self._parts, self._shape = parts, (vehicles, rotors)
        self._external = [a if isinstance(a, ExternalAutopilots) else None for _, a in parts]
        self._by_row = {int(row): (part, i) for rows, part in parts for i, row in enumerate(rows)}

    @property
    def armed(self) -> NDArray[np.bool_]:
        """True for each armed vehicle (V,)."""
        found = np.zeros(self._shape[0], bool)
        for rows, part in self._parts:
            found[rows] = part.armed
        return found

    @property
    def requested(self) -> tuple[str, ...]:
        """Sensors that any part requests."""
        return tuple({name for part in self._external if part is not None for name in part.requested})

    def receive(self, vehicle: int, link: str, data: bytes) -> None:
        """Process a datagram that arrived on one of a vehicle's MAVLink links."""
        part, i = self._by_row[vehicle]
        part.receive(i, link, data)

    def sticks(self, vehicle: int, on: bool) -> None:
        """Switch a pilot's radio control on or off."""
        part, i = self._by_row[vehicle]
        part.sticks(i, on)

    def step(self, now: float, sensors: dict[str, Array]) -> Array:
        """Return motor commands 0..1 (V, R): `begin`, then `finish`."""
        self.begin(now, sensors)
        return self.finish()

    def begin(self, now: float, sensors: dict[str, Array]) -> None:
        """Send the sensor samples to the external autopilots; the others compute in `finish`."""
        self._now = now
        self._sensors = [{key: value[rows] for key, value in sensors.items()} for rows, _ in self._parts]
        for external, part in zip(self._external, self._sensors, strict=True):
            if external is not None:
                external.begin(now, part)

    def finish(self) -> Array:
        """Return the motor commands of all parts, 0..1 (V, R)."""
        motors = np.zeros(self._shape)
        for (rows, part), external, sensors in zip(self._parts, self._external, self._sensors, strict=True):
            found = part.step(self._now, sensors) if external is None else external.finish()
            motors[rows, : found.shape[1]] = found
        return motors

    def receive_truth(self, truth: Truth) -> None:
        """Give each external part the truth of its rows."""
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
        """Return the datagrams to send: (row of the world, link, data)."""
        return [(int(rows[i]), link, data) for rows, part in self._parts for i, link, data in part.transmit()]

    def stats(self) -> dict[str, Any]:
        """Return figures of each vehicle, by name."""
        return {name: figures for _, part in self._parts for name, figures in part.stats().items()}

    def events(self) -> list[str]:
        """Return the events of all parts since the last call."""
        return [text for _, part in self._parts for text in part.events()]

    def close(self) -> None:
        """Close the parts that have something to close."""
        for _, part in self._parts:
            close: Callable[[], None] | None = getattr(part, "close", None)
            if close is not None:
                close()
