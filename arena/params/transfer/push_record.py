"""Record of a push (writing parameters to vehicles) in push.json, to resume the push after an interruption.

It contains the wanted values, the old values, the values written so far, and the values that were sent but not acknowledged.
The record is saved before the first value of a vehicle is written, and repeatedly during the push. A resumed push writes
`wanted` again, except values that the vehicle already has. `before` keeps the values from before the first attempt.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from arena.errors import InputError
from arena.whole_file import replace_file

_FORMAT = "arena params push 1"


@dataclass(kw_only=True)
class VehicleRecord:
    """Values of one vehicle in the record of a parameter push: wanted, old, written and unknown values.

    wanted: parameter -> value that the user wants.
    before: parameter -> old value, for parameters that differed.
    written: parameter -> value that the vehicle acknowledged.
    unknown: parameter -> value that was sent, but which the vehicle may or may not have.
    ending: why the transfer ended; "" while it runs.
    at: address of the vehicle, as text.
    uid: hardware uid of the vehicle; "" before it is known, or if the vehicle sends none.
    px4_version: PX4 version for which the values were generated; "" if the version of the vehicle does not matter; None in a
        record of an earlier `arena`, which does not have it.
    """

    wanted: dict[str, float]
    before: dict[str, float] = field(default_factory=dict)
    written: dict[str, float] = field(default_factory=dict)
    unknown: dict[str, float] = field(default_factory=dict)
    ending: str = ""
    at: str = ""
    uid: str = ""
    px4_version: str | None = ""

    @property
    def complete(self) -> bool:
        """True if the push to this vehicle has ended and no value is unknown."""
        return self.ending == "done" and not self.unknown

    @property
    def unfinished(self) -> bool:
        """True if the vehicle may have received new values, but its push is not complete."""
        return bool(self.written or self.unknown) and not self.complete


class PushRecord:
    """Record of a parameter push to several vehicles, kept in the file `path`.

    Each `save` replaces the whole file.
    """

    def __init__(self, path: Path, vehicles: dict[str, VehicleRecord]) -> None:
        self.path, self.vehicles = path, vehicles

    @classmethod
    def begin(
        cls,
        path: Path,
        wanted: Mapping[str, Mapping[str, float]],
        at: Mapping[str, str] | None = None,
        px4_versions: Mapping[str, str] | None = None,
    ) -> PushRecord:
        """Return the record of a new push. The first `save` writes its file.

        wanted: vehicle -> {parameter: value}.
        at: vehicle -> address, as text.
        px4_versions: vehicle -> PX4 version for which its values were generated. Without an entry, every version is right.
        """
        at, versions = at or {}, px4_versions or {}
        vehicles = {
            name: VehicleRecord(wanted=dict(values), at=at.get(name, ""), px4_version=versions.get(name, ""))
            for name, values in wanted.items()
        }
        return cls(path, vehicles)

    @classmethod
    def read(cls, path: Path) -> PushRecord:
        """Read the record of a parameter push from its file.

        Raises InputError if the file is missing or is not the record of a push.
        """
        try:
            raw = json.loads(path.read_text())
            if raw["format"] != _FORMAT:
                raise ValueError(f"the key `format` is {raw['format']!r}, expected {_FORMAT!r}")
            return cls(path, {str(name): _parse(vehicle) for name, vehicle in raw["vehicles"].items()})
        except OSError as error:
            raise InputError(f"{path}: {error.strerror}: there is no push to resume") from error
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(f"{path} is not the record of `arena params push`: {error}") from error

    @property
    def unfinished(self) -> bool:
        """True if at least one vehicle may have received new values, but its push is not complete."""
        return any(v.unfinished for v in self.vehicles.values())

    @property
    def wanted(self) -> dict[str, dict[str, float]]:
        """Wanted parameters {name: value} of each vehicle whose push is not complete, to resume the push."""
        return {name: dict(v.wanted) for name, v in self.vehicles.items() if not v.complete}

    def update(
        self,
        vehicle: str,
        before: Mapping[str, float],
        written: Mapping[str, float],
        ending: str,
        uid: str = "",
        *,
        unknown: Mapping[str, float] | None = None,
        known: Collection[str] = (),
    ) -> bool:
        """Add new values of one vehicle to the record. Return whether the record has changed.

        before: old values. A value that is already in the record is kept.
        ending: why the transfer ended; "" while it runs, also if the record has the ending of an earlier push.
        unknown: values that were sent, but not acknowledged.
        known: parameters whose value the vehicle has reported. They are not unknown any more.
        """
        old = self.vehicles[vehicle]
        new = VehicleRecord(
            wanted=old.wanted,
            before={**before, **old.before},
            written={**old.written, **written},
            unknown={n: v for n, v in old.unknown.items() if n not in known} | dict(unknown or {}),
            ending=ending,
            at=old.at,
            uid=old.uid or uid,
            px4_version=old.px4_version,
        )
        self.vehicles[vehicle] = new
        return new != old

    def save(self) -> None:
        """Write the record to its file. Raises OSError if the file cannot be written."""
        vehicles = {name: asdict(vehicle) for name, vehicle in self.vehicles.items()}
        text = json.dumps({"format": _FORMAT, "vehicles": vehicles}, indent=1)
        replace_file(self.path, text + "\n")

    def delete(self) -> None:
        """Remove the file of the record, after a complete push."""
        self.path.unlink(missing_ok=True)


def _parse(raw: Any) -> VehicleRecord:
    wanted, before, written, unknown = (
        {str(n): _number(n, v) for n, v in values.items()}
        for values in (raw["wanted"], raw["before"], raw["written"], raw.get("unknown", {}))
    )
    return VehicleRecord(
        wanted=wanted,
        before=before,
        written=written,
        unknown=unknown,
        ending=str(raw["ending"]),
        at=str(raw.get("at", "")),
        uid=str(raw.get("uid", "")),
        px4_version=str(version) if (version := raw.get("px4_version")) is not None else None,
    )


def _number(name: Any, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"parameter {name}: got {value!r}, expected a number")
    return value
