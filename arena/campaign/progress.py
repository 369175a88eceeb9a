"""Progress of a campaign in a terminal: a bar with the time left, or one line per flight in a log file."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.text import Text

from arena.campaign.report import describe
from arena.campaign.store import Record

Clock = Callable[[], float]


class Pace:
    """Estimate of the time left in a campaign.

    It uses the flights that ended since the campaign was started or resumed.

    jobs: number of flights that fly at the same time; 1 if it is not known.
    clock: wall time [s]; replaced by tests.
    """

    def __init__(self, jobs: int = 1, clock: Clock = time.monotonic) -> None:
        self._jobs, self._clock = jobs, clock
        self._began = clock()
        self._here = 0
        self.total = 0
        self.flown = 0

    def begin(self, total: int, flown: int) -> None:
        self._began, self.total, self.flown = self._clock(), total, flown

    def add(self) -> None:
        self._here += 1
        self.flown += 1

    @property
    def left_s(self) -> float | None:
        """Estimated wall time until the end [s]; None before `jobs` flights have ended.

        Before that, the flights that are nearly complete would not count.
        """
        if not self._here or self._here < min(self._jobs, self.total):
            return None
        return (self._clock() - self._began) / self._here * (self.total - self.flown)

    @property
    def left(self) -> str:
        """The time left as text: `2 h 05 min left`; "" if unknown."""
        return "" if self.left_s is None else f"{duration(self.left_s)} left"


def duration(seconds: float) -> str:
    """Return a duration as text: `8 s`, `12 min`, `2 h 05 min`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


class ProgressLines:
    """Progress of a campaign as one line per ended flight, for output to a log file."""

    def __init__(self, pace: Pace, say: Callable[[str], None]) -> None:
        self._pace, self._say = pace, say

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return

    def begin(self, total: int, flown: int, failed: int) -> None:
        self._pace.begin(total, flown)
        before = f", {flown} of them flown before" if flown else ""
        self._say(
            f"{total} flight{'s' if total != 1 else ''}{before}{f' ({failed} failed)' if failed else ''}"
        )

    def add(self, record: Record) -> None:
        self._pace.add()
        left = f", {self._pace.left}" if self._pace.left else ""
        self._say(f"{line(record)}  {self._pace.flown}/{self._pace.total}{left}")

    def refresh(self) -> None:
        return


class ProgressBar:
    """Progress bar of a campaign on a terminal: number of flights and failures, and the time left.

    Failed flights are printed above the bar.

    The bar has no thread, because workers are forked from this process.
    """

    def __init__(self, pace: Pace, console: Console) -> None:
        self._pace, self._failed = pace, 0
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[failed]}", style="red"),
            TextColumn("{task.fields[left]}"),
            console=console,
            auto_refresh=False,
        )
        self._task = self._bar.add_task("flights", total=None, failed="", left="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.refresh()
        self._bar.stop()

    def begin(self, total: int, flown: int, failed: int) -> None:
        self._pace.begin(total, flown)
        self._failed = failed
        self._bar.update(self._task, total=total, completed=flown, failed=self._failures)

    def add(self, record: Record) -> None:
        self._pace.add()
        if not record.passed:
            self._failed += 1
            self._bar.console.print(Text(line(record)))
        self._bar.update(self._task, completed=self._pace.flown, failed=self._failures)

    @property
    def _failures(self) -> str:
        return f"{self._failed} failed" if self._failed else ""

    def refresh(self) -> None:
        self._bar.update(self._task, left=self._pace.left)
        self._bar.refresh()


def line(record: Record) -> str:
    """Return one line of text about a flight that has ended. If the flight failed, give the first reason."""
    word = "passed" if record.passed else "lost  " if record.lost else "FAILED"
    why = f": {record.reasons[0].splitlines()[0]}" if record.reasons else ""
    return f"{word}  {describe(record.number, record.seed, record.settings)}  ({record.wall_s:.0f} s){why}"
