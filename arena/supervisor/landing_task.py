"""The landing before the stop: runs the plan's land task until what may fly is confirmed on the ground, or hope is gone.

Simulated vehicles get some attempts within ATTEMPTS_S: nothing is lost with them. For real ones it tries again for as long as it
takes: what serves a flying vehicle is not stopped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from arena.plan.model import Plan, ProcessSpec
from arena.supervisor.event_log import Journal
from arena.supervisor.process_state import Exit
from arena.supervisor.run_folder import RunFolder
from arena.supervisor.side_task import Task

TIMEOUT_S = 90.0
ATTEMPTS = 3
_PAUSE_S = 1.0
_NOTICE_S = 5.0


class Landing:
    """Feed it what may fly until it says that the landing has ended. landed: confirmed, or nothing flew."""

    def __init__(self, plan: Plan, folder: RunFolder, journal: Journal) -> None:
        self._plan, self._folder, self._journal = plan, folder, journal
        self._real = {v.name for v in plan.vehicles if not v.simulated}
        self.task: Task | None = None
        self.landed = True
        self.words = "nothing was flying"
        self._tries = 0
        self._began: float | None = None
        self._now = self._next = 0.0
        self._nothing_since: float | None = None
        self._down: Mapping[str, str] = {}

    def step(
        self,
        flying: Sequence[str],
        now: float,
        *,
        world_gone: bool = False,
        down: Mapping[str, str] | None = None,
    ) -> bool:
        """flying: vehicles that may be in the air.  now: monotonic [s].  True once it has ended.

        world_gone: the simulated ones are not flying because there is nothing left to fly in.  down: vehicle -> why it is
        not waited for.
        """
        self._now = now
        self._tell_down(down or {})
        if self.task is not None:
            return self._watch(self.task, flying, now)
        if not flying and world_gone and self._tries:
            return self._give_up("the world ended before the vehicles were on the ground")
        if not flying:
            return True
        if self._plan.land is None:
            return self._give_up("the plan has no land task")
        if self._began is None:
            self._began = now
        if not self._real & set(flying) and (self._tries >= ATTEMPTS or now - self._began >= TIMEOUT_S):
            return self._give_up(self.words)
        if now >= self._next:
            self._try(flying, now)
        return False

    def _tell_down(self, down: Mapping[str, str]) -> None:
        for vehicle, why in down.items():
            if vehicle not in self._down:
                self._journal.event(self._now, "arena", f"{vehicle} is not waited for: {why}")
        self._down = {**self._down, **down}

    def _spec(self, flying: Sequence[str]) -> ProcessSpec:
        """The land task, without those that are down: they would never confirm."""
        assert self._plan.land is not None
        spared = [vehicle for vehicle in self._down if vehicle not in flying]
        extra = ("--except", ",".join(spared)) if spared else ()
        return replace(self._plan.land, argv=(*self._plan.land.argv, *extra))

    def _try(self, flying: Sequence[str], now: float) -> None:
        self._tries += 1
        self._next = now + _PAUSE_S
        self.words = f"{', '.join(flying)} to land"
        spec = self._spec(flying)
        self._journal.event(
            now, "arena", f"landing {', '.join(flying)}: {' '.join(self._folder.spec(spec).argv)}"
        )
        begun = Task.start(
            spec, self._folder, TIMEOUT_S, now, lambda text: self._journal.event(self._now, "arena", text)
        )
        if isinstance(begun, Exit):
            self._failed(begun, flying, now)
        else:
            self.task = begun

    def _watch(self, task: Task, flying: Sequence[str], now: float) -> bool:
        exit = task.poll(now)
        if exit is None:
            self._hurry(task, flying, now)
            return False
        self.task, self._next = None, now + _PAUSE_S
        if exit.code == 0:
            self.landed, self.words = True, "landed and disarmed"
            return True
        self._failed(exit, flying, now)
        return False

    def _hurry(self, task: Task, flying: Sequence[str], now: float) -> None:
        """With nothing left to land, the task gets some seconds to notice."""
        if flying:
            self._nothing_since = None
        elif self._nothing_since is None:
            self._nothing_since = now
        elif now - self._nothing_since > _NOTICE_S:
            task.stop()

    def _failed(self, exit: Exit, flying: Sequence[str], now: float) -> None:
        """If the facts say by now that nothing is armed, the next step ends it as landed."""
        self.words = f"the landing of {', '.join(flying) or 'all'} is not confirmed ({exit.words})"
        self._journal.event(now, "arena", self.words)

    def _give_up(self, why: str) -> bool:
        self.landed, self.words = False, why
        return True
