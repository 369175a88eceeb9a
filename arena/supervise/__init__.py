"""The supervisor: it runs a plan and knows nothing of drones. The only room that forks or signals."""

from arena.supervise.control import Control
from arena.supervise.loop import Options, Supervisor
from arena.supervise.runfolder import RunFolder, RunState, active_runs, create, open_run, plan_of
from arena.supervise.show import Lines, LiveTable
from arena.supervise.stale import sweep, sweep_all

__all__ = [
    "Control",
    "Lines",
    "LiveTable",
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
