"""Process of the fused arena, a whole simulated arena in one process: `python -m arena.fused FILE.json`.

FILE.json names the members (router, motion capture, pose forwarders, recorder). Their configuration files (slices) are in the
same folder.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from arena.clock_server import ClockServer
from arena.fused.members import Members
from arena.process_context import ProcessContext, read_slice, run_process
from arena.sim.__main__ import autopilots_by_kind
from arena.sim.loop import run
from arena.socket_watch import SocketWatch


def main() -> int:
    return run_process("arena world", lambda process: _make(process, Path(sys.argv[1]).parent))


def _make(process: ProcessContext, folder: Path) -> Callable[[], None]:
    slices = {name: read_slice(folder / f"{name}.json") for name in process.settings["members"]}

    def links(
        context: ProcessContext,
        world: Mapping[str, Any],
        budget_s: float,
        watch: SocketWatch,
        clock: ClockServer,
    ) -> Members:
        return Members(context, {**slices, "world": world}, budget_s=budget_s, watch=watch, clock=clock)

    return lambda: run(process, slices["world"], autopilots_by_kind, links)


if __name__ == "__main__":
    sys.exit(main())
