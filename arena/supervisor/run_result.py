"""Result of a run: writes outcome.json, and runs the report task, which makes the summary and report.html."""

from __future__ import annotations

import json
import time
from datetime import datetime
from functools import partial

from arena.background_writer import BackgroundWriter
from arena.constants import REPORT_PROGRESS
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

OUTCOME_TIMEOUT_S = 5.0
REPORT_TIMEOUT_S = 120.0
PROGRESS_S = 3.0
"""Period with which the present step of the report is shown [s]. A short report shows none."""


class RunResult:
    """Result of one run at its end: exit code, outcome.json and the report task.

    Call `write` once, then `step` until it returns True.
    writer: thread that writes outcome.json, because the disk may not respond.
    exit_code: exit code of the run; valid after `write`.
    task: the running report task, or None.
    """

    def __init__(
        self,
        plan: Plan,
        folder: RunFolder,
        processes: ProcessSet,
        log: EventLog,
        real_time: RealTimeMeter,
        writer: BackgroundWriter,
    ) -> None:
        self._plan, self._folder, self._processes = plan, folder, processes
        self._log, self._real_time, self._writer = log, real_time, writer
        self._saved: str | None = None
        self._deadline: float | None = None
        self._began, self._began_wall = time.monotonic(), datetime.now().astimezone()
        self.exit_code = EXIT_OK
        self.task: SideTask | None = None
        self._doing = self._report_step = ""
        self._report_began = self._shown_at = 0.0

    def write(self, end: End, landing: LandingTask, until_done: bool, now: float) -> None:
        """Determine the exit code, log every failure, and begin to write outcome.json.

        now: monotonic [s].
        """
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
        self._deadline = now + OUTCOME_TIMEOUT_S
        self._writer.submit(partial(self._save, json.dumps(outcome, indent=1, default=str)))

    def _save(self, text: str) -> None:
        """Write outcome.json. Store the text of the error, or "" after a success.

        It runs in the thread of the writer.
        """
        try:
            write_whole(self._folder.path / "outcome.json", text)
        except OSError as error:
            self._saved = str(error.strerror)
        else:
            self._saved = ""

    def step(self, now: float) -> bool:
        """Wait for outcome.json, then run the report task. Return True when both are complete.

        now: monotonic [s].
        """
        if self.task is not None:
            return self._report_ended(self.task, now)
        if self._saved is None:
            return self._is_late(now)
        if self._saved:
            self._event(f"outcome.json cannot be written ({self._saved}): the result of this run is lost")
        return not self._begin_report(now)

    def _is_late(self, now: float) -> bool:
        """Return whether writing outcome.json takes too long, so that the run must end without it."""
        if self._deadline is None or now < self._deadline:
            return False
        self._event(
            f"outcome.json is not written after {OUTCOME_TIMEOUT_S:g} s, because the disk does not respond: the run ends "
            "without a report"
        )
        return True

    def _begin_report(self, now: float) -> bool:
        """Start the report task. Return False if the plan has no report task or the start fails."""
        if self._plan.report is None:
            return False
        whole = self._plan.report.name == "report"
        self._doing = "making the report" if whole else "writing the logs"
        self._log.show(
            Message(text=f"{self._doing}: logs, summary and report.html" if whole else self._doing)
        )
        self._report_began = self._shown_at = now
        forks = self._processes.forks
        begun = SideTask.start(self._plan.report, self._folder, REPORT_TIMEOUT_S, now, self._on_line, forks)
        if isinstance(begun, Exit):
            self._event(f"no report: {begun.text}")
            return False
        self.task = begun
        return True

    def _report_ended(self, task: SideTask, now: float) -> bool:
        """Return True when the report task has ended."""
        exit = task.poll(now)
        if exit is None:
            self._show_progress(now)
        elif exit.code:
            self._event(
                f"the report failed: {exit.text}; make it again with `arena report {self._folder.path}` "
                f"(log: {self._folder.log(task.name)})"
            )
        return exit is not None

    def _on_line(self, text: str) -> None:
        """Store the present step of the report task, from a line of its output.

        Other lines are ignored: the task's log file contains them, and `arena up` prints the summary.
        """
        _, is_step, step = text.partition(REPORT_PROGRESS)
        if is_step:
            self._report_step = step

    def _show_progress(self, now: float) -> None:
        """Show the present step of the report task once every PROGRESS_S."""
        if now - self._shown_at < PROGRESS_S:
            return
        self._shown_at = now
        step = f": {self._report_step}" if self._report_step else ""
        self._log.show(Message(text=f"{self._doing}{step} ({now - self._report_began:.0f} s)"))

    def _event(self, text: str) -> None:
        self._log.event(time.monotonic(), "arena", text)
