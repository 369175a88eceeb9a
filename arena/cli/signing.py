"""`arena signing`: makes keys for MAVLink message signing, and sends a key to a vehicle over a cable."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from arena.cli._options import Set
from arena.errors import InputError, RunError

if TYPE_CHECKING:
    from arena.schema import Vehicle
    from arena.transport import ConnectionUrl
    from arena.wire.key_exchange import KeyExchange

SETUP_TIMEOUT_S = 15.0
_READ_S = 0.02


def register(app: typer.Typer) -> None:
    """Add the commands of `arena signing` to the typer app."""
    group = typer.Typer(no_args_is_help=True, help="Make and set up keys for MAVLink message signing.")
    for command in (new, setup):
        group.command()(command)
    app.add_typer(group, name="signing")


def new(file: Annotated[Path, typer.Argument(metavar="FILE", help="the new file")]) -> None:
    """Write a random signing key to a new file that only you can read."""
    from arena.signing_key import write_new_key

    write_new_key(file)
    print(
        f"{file}: contains a new signing key. Keep a copy in a safe place; do not add the file to a repository"
    )


def setup(
    vehicle: Annotated[str, typer.Argument(metavar="VEHICLE", help="name of the vehicle in the YAML")],
    arena: Annotated[
        Path, typer.Option("--arena", metavar="FILE", help="the arena's YAML, or its folder")
    ] = Path("arena.yaml"),
    url: Annotated[
        str,
        typer.Option("--url", metavar="URL", help="serial connection to the vehicle. Default: its `url`"),
    ] = "",
    old_key: Annotated[
        Path | None,
        typer.Option("--old-key", metavar="FILE", help="file with the signing key that the vehicle has now"),
    ] = None,
    sets: Set = None,
) -> None:
    """Send the key of `signing.key_file` in the YAML to a disarmed vehicle, over USB or a serial cable."""
    from arena.cli._params import selected_vehicles
    from arena.schema import load_arena
    from arena.signing_key import read_key
    from arena.wire.key_exchange import KeyExchange

    (v,) = selected_vehicles(load_arena(arena, list(sets or [])), [vehicle])
    if not v.key_file:
        raise InputError(
            f"{vehicle} has no signing key: write `signing: {{key_file: FILE}}` under {vehicle} in the YAML"
        )
    connection = serial_connection(v, url)
    exchange = KeyExchange(v.id, read_key(v.key_file), read_key(old_key) if old_key else None)
    run_exchange(exchange, connection, vehicle)
    if exchange.changed:
        print(f"{vehicle}: the vehicle has the new key and signs its messages")
    else:
        print(f"{vehicle}: the vehicle already had this key and signs its messages")


def serial_connection(vehicle: Vehicle, url: str) -> ConnectionUrl:
    """Return the serial connection to a vehicle: from the option --url, else from the YAML.

    Raises InputError for UDP, because the message SETUP_SIGNING contains the key as plain text.
    """
    from arena.transport import parse_url

    try:
        connection = parse_url(url) if url else vehicle.wire
    except ValueError as error:
        raise InputError(f"--url: got {url!r}, expected serial:DEVICE[:BAUD]") from error
    if connection is None or connection.kind != "serial":
        raise InputError(
            f"{vehicle.name}: got {connection}, expected a serial connection. The message SETUP_SIGNING contains the key as plain "
            "text, and everybody on the network could read it. Connect the vehicle by USB and name the device: --url serial:/dev/ttyACM0"
        )
    return connection


def run_exchange(
    exchange: KeyExchange, connection: ConnectionUrl, name: str, timeout_s: float = SETUP_TIMEOUT_S
) -> None:
    """Send the signing key to a vehicle over a serial device, and wait until the vehicle signs its messages.

    Raises RunError if the vehicle does not sign in time.

    timeout_s: time after which the exchange fails [s].
    """
    from arena.transport import SerialPort
    from arena.wire.mavlink_frame import Stream

    try:
        port = SerialPort(connection.device, connection.baud)
    except OSError as error:
        raise RunError(f"{name}: {error}") from error
    stream, end = Stream(), time.monotonic() + timeout_s
    try:
        while not exchange.done and not exchange.problem and (now := time.monotonic()) < end:
            for frame in exchange.due(time.time(), now):
                port.write(frame)
            data = port.read()
            if data is None:
                time.sleep(_READ_S)
            else:
                buffer, found = stream.feed(data)
                exchange.receive(buffer, found.frames)
    except OSError as error:
        raise RunError(f"{name}: the serial device {connection.device} failed: {error.strerror}") from error
    finally:
        port.close()
    if exchange.problem:
        raise RunError(f"{name}: {exchange.problem}")
    if not exchange.done:
        problem = (
            "the vehicle does not sign its messages after SETUP_SIGNING. PX4 signs from version 1.18; is an SD card in it?"
            if exchange.seen
            else f"no heartbeat of the vehicle on {connection}: is it powered, and is its id right?"
        )
        raise RunError(f"{name}: {problem} (waited {timeout_s:g} s)")
