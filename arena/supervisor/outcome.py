"""outcome.json: what the supervisor saw of a run. Written before the report task, which merges it with what others recorded."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any

from arena.supervisor.run_folder import RunFolder, write_whole
from arena.supervisor.shutdown_policy import End


def write(
    folder: RunFolder,
    *,
    name: str,
    began: datetime,
    lasted_s: float,
    end: End,
    exit_code: int,
    failed: Sequence[str],
    landing: str,
    facts: Mapping[str, Any],
    table: Mapping[str, Mapping[str, Any]],
) -> None:
    """began: wall time.  facts: the last of each.  table: one row per process, as `arena ps --json` shows it."""
    text = json.dumps(
        {
            "name": name,
            "run": str(folder.path),
            "start": began.isoformat(timespec="milliseconds"),
            "end": (began + timedelta(seconds=lasted_s)).isoformat(timespec="milliseconds"),
            "duration_s": round(lasted_s, 3),
            "cause": str(end.cause),
            "reason": end.why,
            "exit_code": exit_code,
            "failed": list(failed),
            "landing": landing,
            "facts": dict(facts),
            "processes": {process: dict(row) for process, row in table.items()},
        },
        indent=1,
        default=str,
    )
    write_whole(folder.path / "outcome.json", text)
