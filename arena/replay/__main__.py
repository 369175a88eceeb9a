"""Process that replays a flight: `python -m arena.replay FILE.json`.

FILE.json names the members (router, motion-capture server, recorder). Their configuration files (slices) are in the same folder.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from arena.process_context import ProcessContext, read_slice, run_and_close, run_process
from arena.replay.loopback import check_loopback
from arena.replay.open_script import open_script
from arena.replay.shell import ReplayLoop


def main() -> int:
    return run_process("arena replay", lambda process: _make(process, Path(sys.argv[1]).parent))


def _make(process: ProcessContext, folder: Path) -> Callable[[], None]:
    slices = {name: read_slice(folder / f"{name}.json") for name in process.settings["members"]}
    check_loopback({**slices, "replay": process.settings}, process.settings["stations"])
    loop = ReplayLoop(process, slices, open_script([Path(path) for path in process.settings["sources"]]))
    return run_and_close(loop)


if __name__ == "__main__":
    sys.exit(main())
