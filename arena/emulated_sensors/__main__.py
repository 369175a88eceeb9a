"""Process `sensors`, which emulates relative sensors: `python -m arena.emulated_sensors slice.json`."""

from __future__ import annotations

import sys
from collections.abc import Callable

from arena.emulated_sensors.shell import SensorsShell
from arena.process_context import ProcessContext, run_and_close, run_process


def main() -> int:
    return run_process("sensors", _make)


def _make(process: ProcessContext) -> Callable[[], None]:
    shell = SensorsShell(process)
    process.ready()
    return run_and_close(shell)


if __name__ == "__main__":
    sys.exit(main())
