"""Run a plan file with the real supervisor: `supervised.py PLAN RUNS [until_done] [limit=S] [settle=S] [forks]`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from arena.plan.model import Plan
from arena.supervisor import Level, Lines, Options, Supervisor, create, run_end
from arena.supervisor.fork_client import LOAD_TIMEOUT_S, ForkClient

if TYPE_CHECKING:
    from arena.supervisor import LiveTable


def live_table() -> LiveTable:
    from arena.supervisor import LiveTable  # rich loads slowly

    return LiveTable(Level.DETAIL)


def main() -> int:
    plan = Plan.from_json(Path(sys.argv[1]).read_text())
    limits = [float(a[6:]) for a in sys.argv[3:] if a.startswith("limit=")]
    if settles := [float(a[7:]) for a in sys.argv[3:] if a.startswith("settle=")]:
        run_end.settle_s = lambda plan, stats: settles[0]
    options = Options(
        until_done="until_done" in sys.argv,
        time_limit_s=limits[0] if limits else None,
        adopt="no_adopt" not in sys.argv,
    )
    show = live_table() if "live" in sys.argv else Lines(Level.DETAIL)
    LOAD_TIMEOUT_S["processes"] = (
        120.0  # on a busy machine, too, tests with "forks" get processes of the fork server
    )
    forks = ForkClient(reply_timeout_s=120.0) if "forks" in sys.argv else None
    code = Supervisor(plan, create(plan, Path(sys.argv[2])), show, options, forks).run()
    show.close()
    return code


if __name__ == "__main__":
    sys.exit(main())
