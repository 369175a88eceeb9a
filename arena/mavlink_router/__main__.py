"""Process of the MAVLink router: `python -m arena.mavlink_router slice.json`.

The module for fault injection is imported only if the JSON configuration (slice) has a path in `faults`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

from arena.mavlink_router.routing_table import Table
from arena.mavlink_router.shell import RouterShell
from arena.process_context import ProcessContext, run_and_close, run_process


def main(argv: list[str] | None = None) -> int:
    return run_process("arena:router", _make, argv)


def make_shell(process: ProcessContext) -> RouterShell:
    """Create the `RouterShell` of this process: the sockets and the loop of the router.

    It has fault injection if the configuration contains `faults`, the path of the socket that receives faults.
    """
    table, faults = Table.from_slice(process.settings), process.settings.get("faults")
    if faults is None:
        return RouterShell(process, table)
    from arena.mavlink_router.fault_injection import FaultInjectionShell

    return FaultInjectionShell(process, table, faults)


def _make(process: ProcessContext) -> Callable[[], None]:
    return run_and_close(make_shell(process))


if __name__ == "__main__":
    sys.exit(main())
