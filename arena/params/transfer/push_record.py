"""The record of a push that may be interrupted: what is wanted, what stood there before, what is written. A small JSON file.

It is written before the first value of a vehicle is, and as they go. Whoever resumes pushes `wanted` again: what the vehicle
holds already is not written twice, and `before` keeps the values from before the first attempt.
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
class Entry:
    """One vehicle, names -> values.  wanted: as the user gave them.  before: old values of what differed.  written: acknowledged.

    ending: why it ended, "" while it goes on.  at: which vehicle it is, in the caller's words.
    """

    wanted: dict[str, float]
    before: dict[str, float] = field(default_factory=dict)
    written: dict[str, float] = field(default_factory=dict)
    ending: str = ""
    at: str = ""


class Record:
    """The file at `path`, always whole: each state of it replaces the one before."""

    def __init__(self, path: Path, entries: dict[str, Entry]) -> None:
        self.path, self.entries = path, entries

    @classmethod
    def begin(
        cls, path: Path, wanted: Mapping[str, Mapping[str, float]], at: Mapping[str, str] | None = None
    ) -> Record:
        """A new one. wanted: of each vehicle."""
        return cls(
            path,
            {
                name: Entry(wanted=dict(values), at=(at or {}).get(name, ""))
                for name, values in wanted.items()
            },
        )

    @classmethod
    def read(cls, path: Path) -> Record:
        """To resume it. Raises InputError when there is none, or when the file is something else."""
        try:
            raw = json.loads(path.read_text())
            if raw["format"] != _FORMAT:
                raise ValueError(f"format {raw['format']!r}, expected {_FORMAT!r}")
            return cls(path, {str(name): _entry(entry) for name, entry in raw["vehicles"].items()})
        except OSError as error:
            raise InputError(f"{path}: {error.strerror}: there is no push to resume") from error
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(f"{path}: is no record of a push: {error}") from error

    @property
    def unfinished(self) -> bool:
        """Something was written, and not all of it is done."""
        return any(entry.written and entry.ending != "done" for entry in self.entries.values())

    @property
    def wanted(self) -> dict[str, dict[str, float]]:
        """What is left to push: of the vehicles that were not done."""
        return {name: dict(entry.wanted) for name, entry in self.entries.items() if entry.ending != "done"}

    def note(
        self, vehicle: str, before: Mapping[str, float], written: Mapping[str, float], ending: str
    ) -> bool:
        """What is known now; True when that is news. The oldest value of before stays."""
        entry = self.entries[vehicle]
        before, written = {**before, **entry.before}, {**entry.written, **written}
        new = Entry(
            wanted=entry.wanted,
            before=dict(before),
            written=dict(written),
            ending=ending or entry.ending,
            at=entry.at,
        )
        self.entries[vehicle] = new
        return new != entry

    def save(self) -> None:
        """Raises OSError when it cannot be written."""
        vehicles = {name: asdict(entry) for name, entry in self.entries.items()}
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

    def close(self) -> None:
        """All is done: nothing is left to resume."""
        self.path.unlink(missing_ok=True)


def _entry(raw: Any) -> Entry:
    wanted, before, written = (
        {str(n): _number(v) for n, v in raw[what].items()} for what in ("wanted", "before", "written")
    )
    return Entry(
        wanted=wanted, before=before, written=written, ending=str(raw["ending"]), at=str(raw.get("at", ""))
    )


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{value!r} is no number")
    return value
