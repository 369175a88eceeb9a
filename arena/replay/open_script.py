"""Opens a flight for a replay: the record of a run, or logs of single vehicles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from arena.errors import InputError
from arena.flight_log.open import read_flights
from arena.flight_log.recording import Recording
from arena.flight_log.run_folder import ulogs_of
from arena.replay.flight_script import FlightScript
from arena.replay.parameters import Stored, parameters_of_ulog
from arena.replay.record_script import RecordScript
from arena.wire.flight_record import FILE_NAME


def record_of(path: Path) -> Path | None:
    """Return the path of the record flight.mcap, or None if only log files can be replayed.

    path: the record itself, a run folder, or a log file.
    """
    if path.is_dir():
        found = path / FILE_NAME
        return found if found.is_file() else None
    return path if path.suffix == ".mcap" else None


def open_script(paths: Sequence[Path]) -> RecordScript | FlightScript:
    """Open a run folder, a flight.mcap, or one or more log files (CSV or ULog) for a replay.

    Raises InputError if a file cannot be read, or if a record is given together with other files.
    """
    records = [record for path in paths if (record := record_of(path)) is not None]
    if records and len(paths) > 1:
        raise InputError(
            f"got {records[0]} and {len(paths) - 1} other files: replay one record (flight.mcap, which contains all "
            "vehicles of a run), or several log files, not both"
        )
    if records:
        recording, run = Recording(records[0]), records[0].parent
        return RecordScript(
            recording, {v.name: _parameters(ulogs_of(run, v.name)) for v in recording.vehicles}
        )
    flights = [(flight, path) for path in paths for flight in read_flights(path)]
    return FlightScript([flight for flight, _ in flights], [_parameters([path]) for _, path in flights])


def _parameters(ulogs: Sequence[Path]) -> dict[str, Stored]:
    """Return the autopilot parameters at the start of the first log. Only a ULog contains parameters."""
    return parameters_of_ulog(ulogs[0]) if ulogs else {}
