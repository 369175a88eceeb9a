"""`arena audit RUN`: print the requests to the vehicles of a run, and who had control of the vehicles."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from arena.errors import InputError

_CONTROL = (" has control: ", "released by ", "arm permit", "declared dead")


def register(app: typer.Typer) -> None:
    """Add the command `arena audit` to the typer app."""

    @app.command()
    def audit(
        run: Annotated[Path, typer.Argument(metavar="RUN", help="run folder")],
        vehicle: Annotated[str, typer.Option("--vehicle", metavar="NAME", help="only this vehicle")] = "",
        as_json: Annotated[bool, typer.Option("--json", help="print one JSON object per line")] = False,
    ) -> None:
        """Print who sent which requests to the vehicles of a run, such as arming, and which requests were refused."""
        found = [entry for entry in entries(run) if vehicle in ("", entry["vehicle"])]
        if as_json:
            for entry in found:
                print(json.dumps(entry))
            return
        for entry in found:
            print(line_of(entry))
        if not found:
            print("no request to a vehicle is recorded in this run")


def entries(run: Path) -> list[dict[str, Any]]:
    """Return the requests, changes of control and emergency commands of a run, in the order of time.

    Raises InputError if the folder is not a run folder.
    """
    if not (run / "plan.json").is_file():
        raise InputError(
            f"{run}: not a run folder, because it has no plan.json. `arena runs` lists the run folders"
        )
    vehicles = [str(v["name"]) for v in json.loads((run / "plan.json").read_text())["vehicles"]]
    found = [*_from_events(run / "events.jsonl", vehicles), *_emergency(run / "emergency.jsonl")]
    return sorted(found, key=lambda entry: float(entry["mono"]))


def line_of(entry: dict[str, Any]) -> str:
    """Return one entry of `arena audit` as a line of text.

    An entry is a request to a vehicle, a change of control, or an emergency command.
    """
    at = f"{entry['time_s']:8.1f} s" if "time_s" in entry else str(entry.get("t", ""))[11:21].rjust(10)
    if "event" in entry:
        return f"{at}  {entry['vehicle']}: {entry['event']}"
    result = f"REFUSED: {entry['refused']}" if entry["refused"] else "sent on"
    who = f"{entry['role']} {entry['sender']} from {entry['from']}"
    return f"{at}  {entry['vehicle']}: {entry['request']} by {who}: {result}"


def _from_events(events: Path, vehicles: list[str]) -> Iterator[dict[str, Any]]:
    for entry in _lines(events):
        times: dict[str, Any] = {key: entry[key] for key in ("t", "time_s", "mono") if key in entry}
        if isinstance(request := entry.get("audit"), dict):
            yield {**times, **request}
        vehicle, _, text = str(entry.get("event", "")).partition(": ")
        if vehicle in vehicles and any(word in text for word in _CONTROL):
            yield {**times, "vehicle": vehicle, "event": text}


def _emergency(commands: Path) -> Iterator[dict[str, Any]]:
    for entry in _lines(commands):
        names = entry.get("vehicles")
        for vehicle in names if isinstance(names, list) else ():
            yield {**entry, "vehicle": vehicle, "event": f"`arena {entry.get('command')}` was started"}


def _lines(file: Path) -> Iterator[dict[str, Any]]:
    """Yield the JSON objects of a file with one object per line.

    A missing file has none. A line that is not complete, or has no valid time, is skipped.
    """
    if not file.is_file():
        return
    for line in file.read_text(errors="replace").splitlines():
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError):
            continue
        if isinstance(entry, dict) and _is_time(entry.get("mono")):
            yield entry


def _is_time(value: Any) -> bool:
    try:
        return isinstance(value, int | float) and math.isfinite(value)
    except OverflowError:  # an integer that is too large for a float
        return False
