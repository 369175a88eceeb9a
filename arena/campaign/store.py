"""Folder of a campaign: results.jsonl with one line per flight, and campaign.json with the list of flights.

A line is appended and flushed when its flight ends. So a killed campaign loses only the flights in the air, and a line
that was cut short by the kill is ignored.
"""

from __future__ import annotations

import dataclasses
import fcntl
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path
from typing import Any

from arena.campaign.design import Flight
from arena.campaign.sweep import Sweep, Value
from arena.errors import InputError, RunError
from arena.whole_file import replace_file

RESULTS, CAMPAIGN, LOCK = "results.jsonl", "campaign.json", "campaign.lock"


@dataclass(frozen=True, kw_only=True)
class Record:
    """The result of one flight: one line of results.jsonl.

    lost: whether the flight has no result, because its worker ended. A lost flight is flown again when the campaign is resumed.
    reasons: why the flight failed; empty if it passed.
    run: path of the run folder, relative to the folder of the campaign; "" if there is none.
    wall_s: duration in wall time [s].
    measures: measure -> value; None without data.  vehicles: vehicle -> its measures.
    """

    id: str
    number: int
    seed: int
    settings: Mapping[str, Value]
    passed: bool
    lost: bool = False
    reasons: tuple[str, ...] = ()
    run: str = ""
    wall_s: float = 0.0
    measures: Mapping[str, float | None] = field(default_factory=dict)
    vehicles: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Listing:
    """Content of campaign.json: the settings and the flights of a campaign.

    sweep: path of the sweep file.  kind: `arena` or `scenario`.  flown: path of this file, as the sweep file gives it.
    inputs: path -> SHA-256 of the files that determine a flight.
    flights: id, number, seed and settings of each flight.
    """

    name: str
    sweep: str
    kind: str
    inputs: Mapping[str, str]
    flights: Sequence[Mapping[str, Any]]
    flown: str = ""

    @property
    def settings(self) -> tuple[str, ...]:
        """Names of the settings that vary between the flights of the campaign."""
        return tuple(self.flights[0]["settings"]) if self.flights else ()


class Store:
    """Folder of one campaign, with the files results.jsonl and campaign.json.

    Only the process that holds the lock (`locked`) may write.

    Reading needs no lock.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the folder during a `with` block, so that no other campaign can write to it.

        Raises RunError if another campaign holds the lock, InputError if the folder cannot be made.

        The lock is a POSIX record lock: it ends with this process, and workers do not inherit it.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            file = (self.folder / LOCK).open("w")
        except OSError as error:
            raise InputError(f"{self.folder}: cannot be written: {error.strerror}") from error
        with file:
            try:
                fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise RunError(
                    f"{self.folder}: another `arena campaign` writes to this folder. Wait until that campaign ends, or choose "
                    "another folder with --results"
                ) from None
            yield

    def write_listing(self, listing: Listing) -> None:
        """Write campaign.json as a whole, so that a reader never sees half of the file."""
        path = self.folder / CAMPAIGN
        with _errors_named(path):
            replace_file(path, json.dumps(dataclasses.asdict(listing), indent=1) + "\n")

    def listing(self) -> Listing | None:
        """Return the content of campaign.json; None if the file does not exist.

        Raises InputError if the content is not valid.
        """
        path = self.folder / CAMPAIGN
        try:
            return Listing(**json.loads(path.read_text()))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"{path}: cannot be read: {error}. Choose another folder") from error

    def records(self) -> dict[str, Record]:
        """Return flight id -> record of every flight that has a line in results.jsonl.

        A later line of the same flight replaces an earlier one.
        """
        try:
            text = (self.folder / RESULTS).read_text(errors="replace")
        except FileNotFoundError:
            return {}
        return {record.id: record for record in read_lines(text.split("\n"))}

    @contextmanager
    def appending(self) -> Iterator[Appender]:
        """Open results.jsonl during a `with` block, to append the records of new flights."""
        with (self.folder / RESULTS).open("ab", buffering=0) as file:
            yield Appender(file)


class Appender:
    """Writer of results.jsonl. Each record is on the disk when `append` returns."""

    def __init__(self, file: FileIO) -> None:
        self._file = file
        if file.tell() and not _ends_with_newline(Path(file.name)):
            with _errors_named(file.name):
                file.write(b"\n")  # the last line was cut short when the campaign was killed

    def append(self, record: Record) -> None:
        """Write one record. Raises RunError if the disk does not take it."""
        line = json.dumps(dataclasses.asdict(record), ensure_ascii=False).encode() + b"\n"
        with _errors_named(self._file.name):
            while line:
                line = line[self._file.write(line) :]
            os.fsync(self._file.fileno())


@contextmanager
def _errors_named(path: str | Path) -> Iterator[None]:
    """Convert an OSError inside the `with` block to a RunError that names the file."""
    try:
        yield
    except OSError as error:
        raise RunError(
            f"{path}: cannot be written: {error.strerror}. The campaign ends; the results so far are kept"
        ) from error


def _ends_with_newline(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"


def read_lines(lines: Iterable[str]) -> Iterator[Record]:
    """Yield the record in each line of results.jsonl. Ignore incomplete lines."""
    for line in lines:
        try:
            raw = json.loads(line)
            yield Record(**{**raw, "reasons": tuple(raw["reasons"])})
        except (ValueError, TypeError, KeyError):
            continue


def listing_of(sweep: Sweep, inputs: Mapping[str, str], flights: Sequence[Flight]) -> Listing:
    """Return the content of campaign.json for these flights.

    inputs: path -> SHA-256 of the files that determine a flight.
    """
    rows = [{"id": f.id, "number": f.number, "seed": f.seed, "settings": dict(f.settings)} for f in flights]
    return Listing(
        name=sweep.name,
        sweep=sweep.file,
        kind=sweep.kind,
        flown=str(sweep.source.value((sweep.kind,))),
        inputs=inputs,
        flights=rows,
    )
