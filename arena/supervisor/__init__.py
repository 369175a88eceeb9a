"""The supervisor: starts, monitors, restarts and stops the processes of a plan. It contains no flight control."""

from arena.supervisor.control_socket import Control
from arena.supervisor.loop import Supervisor
from arena.supervisor.messages import Level, Message
from arena.supervisor.run_folder import RunFolder, RunState, active_runs, create, open_run, plan_of
from arena.supervisor.run_options import Options
from arena.supervisor.stale_runs import sweep, sweep_all
from arena.supervisor.terminal import JsonLines, Lines, LiveTable

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
