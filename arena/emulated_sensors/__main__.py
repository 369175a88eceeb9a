"""The process `sensors`, which emulates relative sensors: `python -m arena.emulated_sensors slice.json`."""

from __future__ import annotations

import sys
from collections.abc import Callable

from arena.emulated_sensors.shell import SensorsShell
from arena.process_context import ProcessContext, run_process


def main() -> int:
    return run_process("sensors", _make)


def _make(process: ProcessContext) -> Callable[[], None]:
    shell = SensorsShell(process)

    def serve() -> None:
        process.ready()
        try:
            shell.run()
        finally:
            shell.close()

    return serve


if __name__ == "__main__":
    sys.exit(main())
