"""Landing at the end of a run: repeats the land task (`arena land-all`) until every vehicle has landed.

If only simulated vehicles fly, there are at most ATTEMPTS attempts within TIMEOUT_S, or longer in a slow simulation. If a
real vehicle flies, the number of attempts is not limited, because the processes that serve a flying vehicle must not be stopped.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from arena.plan.model import Plan, ProcessSpec
from arena.supervisor.event_log import EventLog
from arena.supervisor.process_state import Exit
from arena.supervisor.run_folder import RunFolder
from arena.supervisor.side_task import SideTask

TIMEOUT_S = 90.0
ATTEMPTS = 3
_PAUSE_S = 1.0
_NOTICE_S = 5.0
REPORT_LAG_S = 3.0
"""Longest time between the disarming of a real vehicle and the report of the router: three heartbeats [s]."""


class LandingTask:
    """Landing of all vehicles of one run. Call `step` until it returns True.

    landed: true if the landing is confirmed or no vehicle was flying.  summary: state of the landing, for people.
    A vehicle is confirmed when a land task that commanded it has ended with exit code 0. If a real vehicle is still reported as
    armed REPORT_LAG_S later, its confirmation is withdrawn and it is landed again.
    """

    def __init__(self, plan: Plan, folder: RunFolder, log: EventLog) -> None:
        self._plan, self._folder, self._log = plan, folder, log
        self._real = {v.name for v in plan.vehicles if not v.simulated}
        self._limit_s = TIMEOUT_S * plan.slowdown
        self.task: SideTask | None = None
        self._begin()
        self.landed = True
        self.summary = "no vehicle had to be landed"
        self._down: Mapping[str, str] = {}
        self._pilots: set[str] = set()
        self._pilot_flew = False

    def _begin(self) -> None:
        self._tries = 0
        self._began: float | None = None
        self._now = self._next = 0.0
        self._nothing_since: float | None = None
        self._armed: Collection[str] = ()
        self._commanded: set[str] = set()
        self._confirmed: dict[str, float] = {}

    def again(self, why: str, now: float) -> None:
        """Begin a new landing, because a vehicle has been armed after the previous landing.

        why: text for the log.
        """
        self._begin()
        self._log.event(now, "arena", why)

    def step(
        self,
        flying: Sequence[str],
        now: float,
        *,
        armed: Collection[str] = (),
        pilots: Collection[str] = (),
        world_gone: bool = False,
        down: Mapping[str, str] | None = None,
    ) -> bool:
        """Start, monitor or repeat the land task. Return True when the landing has ended, even without success.

        flying: vehicles that may be in the air.  now: monotonic [s].
        armed: vehicles that a running process reports as armed.
        pilots: vehicles whose pilot has control. They are not commanded; they have landed when they are reported disarmed.
        world_gone: the simulated world has ended, so its vehicles do not fly.
        down: vehicle -> reason why the landing does not wait for the vehicle.
        """
        self._now, self._armed = now, armed
        self._log_down(down or {})
        self._withdraw(armed, now)
        flying = [v for v in flying if v not in self._confirmed]
        by_pilot = self._with_pilot(flying, pilots)
        to_land = [v for v in flying if v not in by_pilot]
        if self.task is not None:
            return self._watch(self.task, to_land, by_pilot, now)
        if to_land or not by_pilot:
            return self._land(to_land, now, world_gone=world_gone, armed=armed)
        self._pilot_flew = True
        self.summary = f"{', '.join(by_pilot)} to land: pilot has control"
        return False

    def _land(self, flying: Sequence[str], now: float, *, world_gone: bool, armed: Collection[str]) -> bool:
        """Start the land task if a vehicle may be flying and the next attempt is due.

        Return True when the landing has ended.

        flying: vehicles that may be in the air and that no pilot flies, so that the land task must land them.
        """
        if not flying and world_gone and self._tries and not self._confirmed:
            return self._give_up("the world ended before the vehicles were on the ground")
        if not flying:
            if self._pilot_flew:
                self.summary = "landed and disarmed"
            return not self._real & set(self._confirmed) & set(armed)
        if self._plan.land is None:
            return self._give_up("the plan has no land task")
        if self._began is None:
            self._began = now
        if not self._real & set(flying) and (self._tries >= ATTEMPTS or now - self._began >= self._limit_s):
            return self._give_up(self.summary)
        if now >= self._next:
            self._try(flying, now)
        return False

    def _with_pilot(self, flying: Sequence[str], pilots: Collection[str]) -> list[str]:
        """Return the flying vehicles that pilots control, which land-all must not command.

        Each of them is logged once, when its pilot takes control.
        """
        found = [v for v in flying if v in pilots]
        for vehicle in found:
            if vehicle not in self._pilots:
                self._log.event(
                    self._now, "arena", f"{vehicle}: pilot has control; waiting until the vehicle is disarmed"
                )
        self._pilots = set(found) | (self._pilots & set(flying) & set(pilots))
        return found

    def _withdraw(self, armed: Collection[str], now: float) -> None:
        """Mark a vehicle to be landed again, because it is armed although the land task has confirmed its landing.

        Only reports of a real vehicle from REPORT_LAG_S after the confirmation count. Earlier reports may be outdated.
        """
        for vehicle, at in list(self._confirmed.items()):
            if vehicle in self._real and vehicle in armed and now - at >= REPORT_LAG_S:
                del self._confirmed[vehicle]
                self._log.event(
                    now,
                    "arena",
                    f"{vehicle}: the landing was confirmed, but the vehicle is armed: landing again",
                )

    def _log_down(self, down: Mapping[str, str]) -> None:
        for vehicle, why in down.items():
            if vehicle not in self._down:
                self._log.event(self._now, "arena", f"the landing does not wait for {vehicle}: {why}")
        self._down = {**self._down, **down}

    def _spec(self, flying: Sequence[str]) -> ProcessSpec:
        """Return the land task as a process, whose command line excludes the vehicles that need no landing.

        These vehicles cannot fly any more (crashed, for example), are declared dead, or are flown by a pilot.
        """
        assert self._plan.land is not None
        spared = [v.name for v in self._plan.vehicles if v.name in {*self._down, *self._pilots} - {*flying}]
        self._commanded = {v.name for v in self._plan.vehicles} - set(spared)
        extra = ("--except", ",".join(spared)) if spared else ()
        return replace(self._plan.land, argv=(*self._plan.land.argv, *extra))

    def _try(self, flying: Sequence[str], now: float) -> None:
        self._tries += 1
        self._next = now + _PAUSE_S
        self.summary = f"{', '.join(flying)} to land"
        spec, folder = self._spec(flying), self._folder.for_landing(self._plan)
        self._log.event(now, "arena", f"landing {', '.join(flying)}: {' '.join(folder.spec(spec).argv)}")
        begun = SideTask.start(
            spec, folder, self._limit_s, now, lambda text: self._log.event(self._now, "arena", text)
        )
        if isinstance(begun, Exit):
            self._failed(begun, flying, now)
        else:
            self.task = begun

    def _watch(self, task: SideTask, flying: Sequence[str], by_pilot: Sequence[str], now: float) -> bool:
        exit = task.poll(now)
        if exit is None:
            self._hurry(task, flying, now)
            return False
        self.task, self._next = None, now + _PAUSE_S
        if exit.code == 0:
            self.landed, self.summary = True, "landed and disarmed"
            confirmed = self._commanded - self._pilots
            self._confirmed |= dict.fromkeys(confirmed, now)
            return not ({*flying, *by_pilot} - confirmed or self._real & set(self._armed))
        self._failed(exit, flying, now)
        return False

    def _hurry(self, task: SideTask, flying: Sequence[str], now: float) -> None:
        """Kill the land task if no vehicle has needed a landing for longer than _NOTICE_S."""
        if flying:
            self._nothing_since = None
        elif self._nothing_since is None:
            self._nothing_since = now
        elif now - self._nothing_since > _NOTICE_S:
            task.stop()

    def _failed(self, exit: Exit, flying: Sequence[str], now: float) -> None:
        """Log a failed attempt to land.

        If all vehicles are on the ground anyway, the next `step` ends the landing as successful.
        """
        self.summary = f"the landing of {', '.join(flying) or 'all vehicles'} is not confirmed ({exit.text})"
        self._log.event(now, "arena", self.summary)

    def _give_up(self, why: str) -> bool:
        self.landed, self.summary = False, why
        return True
