"""The command `arena log fetch`, which downloads logs from vehicles over MAVLink."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from arena.cli._options import Set
from arena.errors import EXIT_FAILED, InputError

if TYPE_CHECKING:
    from arena.log_download.session import Fetched
    from arena.params.transfer.transports import ParamTarget


def fetch(
    vehicles: Annotated[
        list[str] | None, typer.Argument(help="names of vehicles. Default: every vehicle of the arena")
    ] = None,
    arena: Annotated[
        Path, typer.Option("--arena", metavar="FILE", help="the arena's YAML, or its folder")
    ] = Path("arena.yaml"),
    number: Annotated[
        int | None,
        typer.Option(
            "--log", metavar="N", help="number of the log, as --list shows it. Default: the newest log"
        ),
    ] = None,
    only_list: Annotated[
        bool, typer.Option("--list", help="list the logs of the vehicles; download none")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            metavar="DIR",
            help="folder of the logs. Default: `ulog` in the folder of the running arena, else in the current folder",
        ),
    ] = None,
    url: Annotated[
        str,
        typer.Option(
            "--url",
            metavar="URL",
            help="connect to this address, without a YAML, for example udpin:0.0.0.0:14550 or serial:/dev/ttyUSB0",
        ),
    ] = "",
    system: Annotated[
        int, typer.Option("--id", metavar="ID", help="MAVLink system id of the vehicle at --url")
    ] = 1,
    set_: Set = None,
) -> None:
    """Download the newest log (ULog) of disarmed vehicles over MAVLink. An interrupted download continues at the next call."""
    from arena.cli._params_output import ProgressBars, ending_text
    from arena.log_download.session import fetch_logs

    targets, folder = _targets(vehicles, arena, url, system, set_ or [])
    folder = out or folder
    with ProgressBars(list(targets)) as bars:
        results = fetch_logs(targets, folder, number=number, only_list=only_list, on_progress=bars.show)
    failed = False
    for name, result in results.items():
        good = bool(result.entries) if only_list else result.path is not None
        failed |= not good
        for line in _lines(name, result, only_list=only_list, ending=ending_text(result.ending, result.why)):
            print(line)
    if failed:
        raise typer.Exit(EXIT_FAILED)


def _targets(
    names: list[str] | None, file: Path, url: str, system: int, set_: list[str]
) -> tuple[dict[str, ParamTarget], Path]:
    """Return {vehicle name: address} of the vehicles whose logs to download, and the default log folder."""
    if not url:
        from arena.cli._params import run_folder_of, selected_vehicles, targets_of
        from arena.schema import load_arena

        lab = load_arena(file, set_)
        return targets_of(lab, selected_vehicles(lab, names)), run_folder_of(lab) / "ulog"
    from arena.params.transfer.transports import ParamTarget
    from arena.transport import parse_url

    try:
        at = parse_url(url)
    except ValueError as error:
        raise InputError(f"--url: {error}") from error
    if names and len(names) > 1:
        raise InputError(f"--url {url}: got {len(names)} vehicle names, expected one")
    name = names[0] if names else f"vehicle{system}"
    if at.kind == "serial":
        return {name: ParamTarget(system=system, device=at.device, baud=at.baud)}, Path("ulog")
    there = (at.host, at.port)
    target = (
        ParamTarget(system=system, local=there)
        if at.kind == "udpin"
        else ParamTarget(system=system, remote=there)
    )
    return {name: target}, Path("ulog")


def _lines(name: str, result: Fetched, *, only_list: bool, ending: str) -> list[str]:
    """Return the output of `arena log fetch` for one vehicle, as lines: its download, or the list of its logs."""
    if only_list and result.entries:
        return [
            f"{name}: log {entry.number}: {entry.size / 1e6:.2f} MB{_date(entry.time_s)}"
            for entry in result.entries
        ]
    if result.path is not None and result.entry is not None:
        rate = result.entry.size / max(result.seconds, 1e-3) / 1e3
        return [
            f"{name}: log {result.entry.number}: {result.path} ({result.entry.size / 1e6:.2f} MB, {rate:.0f} kB/s)"
        ]
    if result.ending == "armed":
        ending = "the vehicle is armed. Fetch the log after the flight"
    left = f"; {result.missing} bytes are missing, the same command continues" if result.missing else ""
    return [f"{name}: no log: {ending}{left}"]


def _date(time_s: int) -> str:
    """Return the date of a log as text for the list; "" if the log has no date.

    time_s: Unix time of the last change of the log [s]; 0 if the vehicle does not know the date.
    """
    return f", {datetime.fromtimestamp(time_s, UTC):%Y-%m-%d %H:%M:%S} UTC" if time_s else ""
