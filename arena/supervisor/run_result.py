"""The result of a run: writes outcome.json, and runs the report task, which makes summary and plots from it."""

from __future__ import annotations

import json
import time
from datetime import datetime

from arena.errors import EXIT_OK
from arena.plan.model import Plan
from arena.supervisor import run_end
from arena.supervisor.event_log import EventLog
from arena.supervisor.landing_task import LandingTask
from arena.supervisor.messages import Message
from arena.supervisor.meters import RealTimeMeter
from arena.supervisor.process_set import ProcessSet
from arena.supervisor.process_state import Exit
from arena.supervisor.run_end import End
from arena.supervisor.run_folder import RunFolder, write_whole
from arena.supervisor.side_task import SideTask

REPORT_TIMEOUT_S = 120.0


class RunResult:
    """Determines the result of one run at its end: writes outcome.json, sets `exit_code`, and runs the report task.

    exit_code: exit code of the run; valid after `write`.
    task: the running report task, or None.
    """

    def __init__(
        self, plan: Plan, folder: RunFolder, processes: ProcessSet, log: EventLog, real_time: RealTimeMeter
    ) -> None:
        self._plan, self._folder, self._processes = plan, folder, processes
        self._log, self._real_time = log, real_time
        self._began, self._began_wall = time.monotonic(), datetime.now().astimezone()
        self.exit_code = EXIT_OK
        self.task: SideTask | None = None

    def write(self, end: End, landing: LandingTask, until_done: bool, now: float) -> None:
        """Write outcome.json and log every failure. A file that cannot be written is reported; the exit code is still valid."""
        p = self._processes
        failed = run_end.failures(self._plan, end, p.statuses, p.stats, landing.landed, until_done)
        self.exit_code = run_end.exit_code(end, failed, landing.landed)
        for text in failed:
            self._event(f"failed: {text}")
        outcome = run_end.outcome(
            name=self._plan.name,
            run=str(self._folder.path),
            began=self._began_wall,
            lasted_s=now - self._began,
            end=end,
            exit_code=self.exit_code,
            failed=failed,
            landing=landing.summary,
            real_time=self._real_time.result(),
        )
        outcome |= {"facts": p.last_facts, "processes": p.table(now)}
        try:
            write_whole(self._folder.path / "outcome.json", json.dumps(outcome, indent=1, default=str))
        except OSError as error:
            self._event(f"outcome.json cannot be written ({error.strerror}): the result of this run is lost")

    def begin_report(self, now: float) -> bool:
        """Start the report task. Return False if there is none, or if it cannot be started."""
        if self._plan.report is None:
            return False
        self._log.show(Message(text="making the report: summary, logs and plots"))
        begun = SideTask.start(self._plan.report, self._folder, REPORT_TIMEOUT_S, now, _ignore)
        if isinstance(begun, Exit):
            self._event(f"no report: {begun.text}")
            return False
        self.task = begun
        return True

    def report_ended(self, now: float) -> bool:
        """Return True when the report task has ended."""
        exit = self.task.poll(now) if self.task is not None else Exit(code=0, text="")
        if exit is None:
            return False
        if exit.code and self.task is not None:
            self._event(f"the report failed: {exit.text}; see {self._folder.log(self.task.name)}")
        return True

    def _event(self, text: str) -> None:
        self._log.event(time.monotonic(), "arena", text)


def _ignore(text: str) -> None:
    """Ignore an output line of the report task. The task's log file contains the line, and `arena up` prints
    the summary.
    """
