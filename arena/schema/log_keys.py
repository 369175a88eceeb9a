"""The YAML keys under `log`: the logs of a flight, and the live view for Foxglove."""

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from arena.schema.base import Address, Port, Strict


def _foxglove(value: Any) -> Any:
    if value is None or value is False:
        return None
    if value is True:
        return {}
    if isinstance(value, int):
        return {"port": value}
    if isinstance(value, (dict, Foxglove)):
        return value
    raise ValueError(
        "expected true, false, the port of Foxglove's WebSocket, or a mapping with the keys address and port"
    )


class Foxglove(Strict):
    """WebSocket on which Foxglove shows the flight live.

    It needs no password and accepts no commands.
    """

    address: Address | None = None
    """Numeric address that the server binds. Who reaches this address can read the flight. Default: the arena's `address`."""
    port: Port = 8765
    """TCP port of the server."""


class LogKeys(Strict):
    """YAML keys of the logs in the run folder: `flight.mcap`, `csv/VEHICLE.csv` and `ulog/VEHICLE.ulg`."""

    rate_hz: Annotated[float, Field(ge=1, le=250)] = 30.0
    """Rows per second of the CSV files, and recorded true states per second of simulated vehicles [Hz]."""
    ulog: bool = True
    """Write `ulog/VEHICLE.ulg`, a log in PX4's format, for each vehicle with the built-in autopilot, as its parameter SDLOG_MODE says."""
    foxglove: Annotated[Foxglove | None, BeforeValidator(_foxglove)] = None
    """Live view for Foxglove: true, a port, or a mapping with the keys address and port. Default: false."""
