"""The supervisor: starts, monitors, restarts and stops the processes of a plan. It contains no flight control.

Each name is imported when it is first used: commands that only look for runs need neither the supervisor's loop nor rich.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from arena.supervisor.control_socket import Control
    from arena.supervisor.live_table import LiveTable
    from arena.supervisor.loop import Supervisor
    from arena.supervisor.messages import Level, Message
    from arena.supervisor.run_folder import RunFolder, RunState, active_runs, create, open_run, plan_of
    from arena.supervisor.run_options import Options
    from arena.supervisor.stale_runs import sweep, sweep_all
    from arena.supervisor.terminal import JsonLines, Lines

__all__ = [
    "Control",
    "JsonLines",
    "Level",
    "Lines",
    "LiveTable",
    "Message",
    "Options",
    "RunFolder",
    "RunState",
    "Supervisor",
    "active_runs",
    "create",
    "open_run",
    "plan_of",
    "sweep",
    "sweep_all",
]
_MODULES = {
    "control_socket": ("Control",),
    "live_table": ("LiveTable",),
    "loop": ("Supervisor",),
    "messages": ("Level", "Message"),
    "run_folder": ("RunFolder", "RunState", "active_runs", "create", "open_run", "plan_of"),
    "run_options": ("Options",),
    "stale_runs": ("sweep", "sweep_all"),
    "terminal": ("JsonLines", "Lines"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name of this package when it is first used.

    Then a command loads only the modules that it needs.
    """
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
