"""`python -m arena.mavlink_router slice.json`: the router process.

The shell with fault injection is imported and used only when the slice names a socket for faults.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

from arena.mavlink_router.routing_table import Table
from arena.mavlink_router.shell import RouterShell
from arena.process_context import ProcessContext, run_room


def main(argv: list[str] | None = None) -> int:
    return run_room("arena:router", _make, argv)


def make_shell(process: ProcessContext) -> RouterShell:
    """Return the shell that the process's slice asks for: with fault injection when `faults` is a path."""
    table, faults = Table.from_slice(process.settings), process.settings.get("faults")
    if faults is None:
        return RouterShell(process, table)
    from arena.mavlink_router.fault_injection import FaultInjectionShell

    return FaultInjectionShell(process, table, faults)


def _make(process: ProcessContext) -> Callable[[], None]:
    shell = make_shell(process)

    def serve() -> None:
        try:
            shell.run()
        finally:
            shell.close()

    return serve


if __name__ == "__main__":
    sys.exit(main())
