"""The record of a push (push.json): the wanted values, the values before, the values written.

The record is saved before the first value of a vehicle is written, and while the push goes on. A resumed push writes `wanted` again:
values that the vehicle already has are not written twice, and `before` keeps the values from before the first attempt.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from arena.errors import InputError

_FORMAT = "arena params push 1"


@dataclass(kw_only=True)
class VehicleRecord:
    """The part of one vehicle, parameter -> value.

    wanted: as the user gave them.
    before: old values of the parameters that differed.
    written: values that the vehicle acknowledged.
    ending: why the transfer ended; "" while it runs.
    at: where the vehicle is reached, as text.
    """

    wanted: dict[str, float]
    before: dict[str, float] = field(default_factory=dict)
    written: dict[str, float] = field(default_factory=dict)
    ending: str = ""
    at: str = ""


class PushRecord:
    """The record file at `path`. Each saved state replaces the one before as a whole."""

    def __init__(self, path: Path, vehicles: dict[str, VehicleRecord]) -> None:
        self.path, self.vehicles = path, vehicles

    @classmethod
    def begin(
        cls, path: Path, wanted: Mapping[str, Mapping[str, float]], at: Mapping[str, str] | None = None
    ) -> PushRecord:
        """Return the record of a new push, not saved yet.

        wanted: vehicle -> {parameter: value}.
        at: vehicle -> where it is reached, as text.
        """
        return cls(
            path,
            {
                name: VehicleRecord(wanted=dict(values), at=(at or {}).get(name, ""))
                for name, values in wanted.items()
            },
        )

    @classmethod
    def read(cls, path: Path) -> PushRecord:
        """Read a record. Raises InputError when the file is missing or is no record."""
        try:
            raw = json.loads(path.read_text())
            if raw["format"] != _FORMAT:
                raise ValueError(f"format {raw['format']!r}, expected {_FORMAT!r}")
            return cls(path, {str(name): _parse(vehicle) for name, vehicle in raw["vehicles"].items()})
        except OSError as error:
            raise InputError(f"{path}: {error.strerror}: there is no push to resume") from error
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(f"{path}: is not the record of a push: {error}") from error

    @property
    def unfinished(self) -> bool:
        """True when values were written to a vehicle that is not done."""
        return any(vehicle.written and vehicle.ending != "done" for vehicle in self.vehicles.values())

    @property
    def wanted(self) -> dict[str, dict[str, float]]:
        """Vehicle -> {parameter: value} of the vehicles that are not done."""
        return {name: dict(v.wanted) for name, v in self.vehicles.items() if v.ending != "done"}

    def update(
        self, vehicle: str, before: Mapping[str, float], written: Mapping[str, float], ending: str
    ) -> bool:
        """Update one vehicle and return whether anything changed. The oldest values in `before` stay."""
        old = self.vehicles[vehicle]
        new = VehicleRecord(
            wanted=old.wanted,
            before={**before, **old.before},
            written={**old.written, **written},
            ending=ending or old.ending,
            at=old.at,
        )
        self.vehicles[vehicle] = new
        return new != old

    def save(self) -> None:
        """Write the file. Raises OSError when it cannot be written."""
        vehicles = {name: asdict(vehicle) for name, vehicle in self.vehicles.items()}
        text = json.dumps({"format": _FORMAT, "vehicles": vehicles}, indent=1)
        part = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        try:
            with part.open("w") as file:
                file.write(text + "\n")
                file.flush()
                os.fsync(file.fileno())
            part.replace(self.path)
        except OSError:
            with contextlib.suppress(OSError):
                part.unlink()
            raise

    def delete(self) -> None:
        """Remove the file after a complete push."""
        self.path.unlink(missing_ok=True)


def _parse(raw: Any) -> VehicleRecord:
    wanted, before, written = (
        {str(n): _number(v) for n, v in raw[what].items()} for what in ("wanted", "before", "written")
    )
    return VehicleRecord(
        wanted=wanted, before=before, written=written, ending=str(raw["ending"]), at=str(raw.get("at", ""))
    )


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{value!r} is not a number")
    return value
