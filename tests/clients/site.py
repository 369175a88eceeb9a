"""The arena that client tests connect to: its ports and its truth."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from end_to_end.flight import Flight, eventually

from arena.errors import RunError


@dataclass(kw_only=True)
class Site:
    """A running arena with one vehicle. kind: "builtin" or "px4"; vehicle: MAVLink system id."""

    flight: Flight
    kind: str
    vehicle: int

    @property
    def address(self) -> str:
        return self.flight.address

    @property
    def sdk_url(self) -> str:
        return f"udpin://{self.address}:{22000 + self.vehicle}"

    @property
    def tools(self) -> str:
        """Return the tools port: any local client may connect to it."""
        return f"{self.address}:{24000 + 10 * self.vehicle + 6}"

    def position(self) -> Any:
        """Return the true position [m] [NED] (3,)."""
        return self.flight.truth().p_n[0]

    def down(self, limit_s: float = 40.0) -> None:
        """Wait until the vehicle is on the floor and disarmed."""
        self.flight.until_down(limit_s)
        self.flight.until_disarmed(["uav1"], limit_s)

    def ready(self) -> None:
        """Wait until the router receives the vehicle."""

        def heard() -> Any:
            assert self.flight.process.poll() is None, self.flight.said()
            with suppress(RunError):  # its control socket is not there at first
                return self.flight.fact("uav1.mode")

        eventually(heard, 60, "a vehicle that is heard", self.flight.said)
