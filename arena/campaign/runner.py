"""Flights of a campaign in worker processes on this computer.

A flight whose worker was killed is flown again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from arena.campaign.design import Flight
from arena.campaign.fly import fly
from arena.campaign.store import Record
from arena.smoke.flying.workers import Lost, run_all
from arena.supervisor.fork_client import ForkClient

ATTEMPTS = 3
"""Number of times that a flight is begun before it counts as lost."""
OnRecord = Callable[[Record], None]
Fly = Callable[[Flight, Path], Record]


def fly_all(
    flights: Sequence[Flight],
    folder: Path,
    *,
    jobs: int,
    on_record: OnRecord,
    on_poll: Callable[[], None] = lambda: None,
    flown_by: Fly = fly,
    forks: ForkClient | None = None,
) -> None:
    """Fly all flights in worker processes, `jobs` of them at the same time.

    on_record: function that is called with the record of each flight when the flight ends.
    on_poll: function that is called several times per second, for example to draw the progress.
    flown_by: function that flies one flight; replaced by tests.
    forks: fork server for the workers and their arenas; None: none. It is used only with the default `flown_by`.
    Raises KeyboardInterrupt after Ctrl-C, when all arenas have ended.
    """
    waiting, lost = list(flights), list[tuple[Flight, Lost]]()

    def note(flight: Flight, result: Record | Lost) -> None:
        if isinstance(result, Lost):
            lost.append((flight, result))
        else:
            on_record(result)

    for _ in range(ATTEMPTS):
        lost.clear()
        work = partial(_fly, folder, flown_by)
        run_all(
            waiting, work, jobs=jobs, on_end=note, on_poll=on_poll, forks=forks if flown_by is fly else None
        )
        waiting = [flight for flight, _ in lost]
    for flight, end in lost:
        on_record(lost_record(flight, f"exit code {end.exit_code}"))


def _fly(folder: Path, flown_by: Fly, flight: Flight) -> Record:
    return flown_by(flight, folder)


def lost_record(flight: Flight, why: str, times: int = ATTEMPTS) -> Record:
    """Return the record of a flight that has no result after all attempts.

    why: how the last worker ended.  times: number of attempts.
    """
    count = "once" if times == 1 else f"{times} times"
    said = f"the process that flew the flight ended without a result, {count} ({why})"
    return Record(
        id=flight.id,
        number=flight.number,
        seed=flight.seed,
        settings=dict(flight.settings),
        passed=False,
        lost=True,
        reasons=(said,),
    )
