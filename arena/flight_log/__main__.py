"""Writes `csv/<vehicle>.csv` and `tlog/<vehicle>.tlog` from the record of a run: `python -m arena.flight_log RUN`."""

from __future__ import annotations

import sys
from pathlib import Path

from arena.errors import ArenaError
from arena.flight_log.record_completion import complete_record
from arena.flight_log.run_folder import has_record, write_csv_files, write_tlog_files
from arena.wire.flight_record import FILE_NAME


def main() -> int:
    run = Path(sys.argv[1])
    try:
        if has_record(run):
            complete_record(run / FILE_NAME)
            write_csv_files(run)
            write_tlog_files(run)
    except (ArenaError, OSError) as error:
        print(f"logs: {error}", file=sys.stderr)
        return error.exit_code if isinstance(error, ArenaError) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
