"""Opens what is to be replayed: the record of a run, or logs of single vehicles."""

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
    """Return the path of the record: `path` itself or the one in a run folder; None if only logs of vehicles can be replayed."""
    if path.is_dir():
        found = path / FILE_NAME
        return found if found.is_file() else None
    return path if path.suffix == ".mcap" else None


def open_script(paths: Sequence[Path]) -> RecordScript | FlightScript:
    """Return the script of a run folder, a flight.mcap, or one or more logs: CSV files or PX4's ULogs.

    Raises InputError if a file cannot be read, or if a record is given together with other files.
    """
    records = [record for path in paths if (record := record_of(path)) is not None]
    if records and len(paths) > 1:
        raise InputError(
            f"a record already contains all vehicles: got {records[0]} and {len(paths) - 1} other files. Replay one record, or several logs"
        )
    if records:
        recording, run = Recording(records[0]), records[0].parent
        return RecordScript(
            recording, {v.name: _parameters(ulogs_of(run, v.name)) for v in recording.vehicles}
        )
    flights = [(flight, path) for path in paths for flight in read_flights(path)]
    return FlightScript([flight for flight, _ in flights], [_parameters([path]) for _, path in flights])


def _parameters(ulogs: Sequence[Path]) -> dict[str, Stored]:
    """Return the parameters at the start of the first log; none without a ULog."""
    return parameters_of_ulog(ulogs[0]) if ulogs else {}
