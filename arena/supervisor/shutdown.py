"""Shutdown of a run: lands the vehicles, then stops the processes.

Processes that an armed vehicle needs are stopped last.

A process serves a vehicle if the vehicle needs it to fly and to land: world, motion capture, PX4, link, pose forwarder, router.
In the phase LAND, motion capture, links, pose forwarders and router are restarted if they crash or hang. In the phase STOP,
programs, tools, the recorder and the copilot are stopped first. The processes that serve a real vehicle are stopped SETTLE_S after
them, and only while the vehicle is disarmed. If a vehicle becomes armed in STOP, the run returns to LAND.
"""

from __future__ import annotations

from arena.plan.model import Plan
from arena.supervisor import run_end
from arena.supervisor.event_log import EventLog
from arena.supervisor.landing_task import LandingTask
from arena.supervisor.process_set import Orders, ProcessSet
from arena.supervisor.process_state import State
from arena.supervisor.release import guards
from arena.supervisor.run_end import Cause
from arena.supervisor.run_folder import RunFolder

SETTLE_S = 1.5
"""Time between the end of the last program and the end of the router, in an arena with real vehicles [s].

A program may have armed a vehicle just before its end. The vehicle reports it in its next heartbeat, at most 1 s later.
"""


class Shutdown:
    """Lands the vehicles of one run at its end, then stops its processes.

    at_once: `arena down --now` was requested: simulated vehicles are not landed.
    forgotten: vehicle -> who declared it dead (`arena forget`); the run does not wait for such a vehicle.
    """

    def __init__(
        self, plan: Plan, folder: RunFolder, processes: ProcessSet, orders: Orders, log: EventLog
    ) -> None:
        self._plan, self._processes, self._orders, self._log = plan, processes, orders, log
        self.landing = LandingTask(plan, folder, log)
        self.at_once = False
        self.forgotten: dict[str, str] = {}
        self._armed_before: set[str] = set()
        self._users_ended_at: float | None = None
        self._again = False

    def flying(self) -> list[str]:
        """Return the vehicles that may be in the air."""
        p = self._processes
        return run_end.may_fly(self._plan, p.statuses, p.facts, p.last_facts, p.stats, self.forgotten)

    def armed(self) -> set[str]:
        """Return the vehicles that a running process reports as armed, except vehicles that were declared dead."""
        p = self._processes
        return run_end.armed(self._plan, p.statuses, p.facts, p.stats) - self.forgotten.keys()

    def update_armed(self, now: float) -> None:
        """Find the processes that serve an armed real vehicle, and the user programs that fly one. now: monotonic [s]."""
        armed, all_vehicles = self.armed(), {v.name for v in self._plan.vehicles}
        self._orders.hold = run_end.serving_real(self._plan, armed)
        reported = self._processes.armed_reports.take(all_vehicles, now)
        self._orders.armed = run_end.flying_real(self._plan, armed | reported)

    def forget(self, vehicle: str, by: str, now: float) -> None:
        """Stop waiting for a vehicle with a real autopilot that an operator declares dead. Raises ValueError if this is refused.

        by: name of the operator.  now: monotonic [s].
        """
        facts = self._processes.facts
        real = [v.name for v in self._plan.vehicles if not v.simulated or v.autopilot == run_end.HITL]
        if vehicle not in real:
            expected = f"expected one of {', '.join(real)}" if real else "but this arena has no real vehicle"
            raise ValueError(f"only a real vehicle can be declared dead: got {vehicle!r}, {expected}")
        if facts.get(f"{vehicle}.connected") is True and vehicle in self.armed():
            raise ValueError(
                f"{vehicle} cannot be declared dead: it is armed and sends telemetry, so it could be in the air. Land it "
                f"(`arena land-all --only {vehicle}`), stop its motors (`arena kill-all --only {vehicle} --yes`) or unplug its battery. "
                "It can be declared dead when it is disarmed, or 3 s after its last heartbeat"
            )
        self.forgotten[vehicle] = by
        self._log.event(
            now,
            "arena",
            f"{vehicle}: {by} has declared this vehicle dead; the end of the run does not wait for it",
        )
        self._send_forgotten(vehicle, dead=True)

    def recall_forgotten(self, now: float) -> None:
        """Wait again for a vehicle that was declared dead, if it sends telemetry and is armed.

        now: monotonic [s].
        """
        facts = self._processes.facts
        for vehicle, by in list(self.forgotten.items()):
            if facts.get(f"{vehicle}.connected") is True and facts.get(f"{vehicle}.armed") is True:
                del self.forgotten[vehicle]
                text = (
                    f"{vehicle}: {by} has declared this vehicle dead, "
                    "but it sends telemetry and is armed: the run waits for it again"
                )
                self._log.event(now, "arena", text)
                self._send_forgotten(vehicle, dead=False)

    def _send_forgotten(self, vehicle: str, *, dead: bool) -> None:
        packet = {"do": "forget", "vehicle": vehicle, "dead": dead}
        serving = run_end.serving_real(self._plan, [vehicle])
        self._processes.request(packet, to=serving, standing=True)
        self._processes.changed = True

    def begin(self, cause: Cause) -> None:
        """Begin the shutdown of the run: refuse arming from now on, and start only processes that a landing needs."""
        self._orders.starts_on, self._orders.why = False, f"the run ends: {cause}"
        self._keep_serving()
        packet = {"do": "refuse_arming", "why": "the run is ending"}
        self._processes.request(packet, to=guards(self._plan), standing=True)

    def _keep_serving(self) -> None:
        """Request restarts of the processes that vehicles need to land, if they end before the landing has ended."""
        self._orders.keep = run_end.kept_in_landing(self._plan, self._processes.statuses)

    def land(self, now: float) -> bool:
        """Land the vehicles; call it in each cycle. Return True when the landing has ended, even without success."""
        p, plan = self._processes, self._plan
        flying, down = self.flying(), run_end.grounded(plan, p.statuses, p.stats)
        down |= {name: f"{who} has declared this vehicle dead" for name, who in self.forgotten.items()}
        if self.at_once:
            flying, down = self._real_only(flying, down)
        if self._again:
            self._revive(self.armed())
        done = self.landing.step(
            flying,
            now,
            armed=self.armed(),
            pilots=run_end.with_pilot(plan, p.facts, p.last_facts),
            world_gone=run_end.is_world_gone(plan, p.statuses),
            down=down,
        )
        if done:
            self._orders.keep = frozenset()
            self._armed_before = self.armed()
            p.changed = True
        return done

    def _real_only(self, flying: list[str], down: dict[str, str]) -> tuple[list[str], dict[str, str]]:
        """Exclude simulated vehicles from the landing, for `arena down --now`.

        Return `flying` without these vehicles, and `down` with them. `arena down --now` lands real vehicles only, so the landing
        must not wait for a simulated vehicle.

        flying: vehicles that may be in the air.  down: vehicle -> reason why the landing does not wait for the vehicle.
        """
        simulated = {v.name for v in self._plan.vehicles if v.simulated}
        left = simulated & set(flying)
        if left:
            self.landing.summary = f"{', '.join(sorted(left))} not landed: {Cause.DOWN} --now"
        real = [name for name in flying if name not in simulated]
        return real, {**down, **dict.fromkeys(sorted(left), f"{Cause.DOWN} --now lands real vehicles only")}

    def armed_again(self, now: float) -> bool:
        """Return True if a vehicle was armed again after the landing. The next call of `land` lands this vehicle."""
        found = self.armed() - self._armed_before
        self._armed_before &= self.armed()
        if self.at_once:
            found -= {v.name for v in self._plan.vehicles if v.simulated}
        if not found:
            return False
        names = ", ".join(sorted(found))
        self.landing.again(f"{names} was armed while the arena was stopping: landing again", now)
        self._again = True
        self._keep_serving()
        return True

    def _revive(self, vehicles: set[str]) -> None:
        """Restart the stopped processes that given vehicles need to land."""
        serving = {s.name for s in self._plan.processes if (s.vehicle or "") in {"", *vehicles}}
        needed = self._orders.keep & serving if vehicles else frozenset()
        self._orders.stop -= needed
        for name in needed:
            if self._processes.statuses[name].state is State.EXITED:
                self._processes.request_restart(name)

    def stop(self, now: float) -> bool:
        """Request the stop of every process that may end now. Return True when no process runs any more."""
        p, orders = self._processes, self._orders
        alive = set(p.alive)
        if not alive:
            return True
        waiting = self._waiting(alive, now)
        may_stop = run_end.may_stop(self._plan, p.statuses) & alive
        stopping = (alive if self.at_once else may_stop or alive) - waiting
        orders.stop |= stopping
        p.changed = p.changed or any(p.statuses[name].state is not State.STOPPING for name in stopping)
        return False

    def _waiting(self, alive: set[str], now: float) -> frozenset[str]:
        """Return the processes that must not be stopped yet, because they serve a connected real vehicle."""
        p = self._processes
        reported = {v.name for v in self._plan.vehicles if f"{v.name}.armed" in p.last_facts}
        serving = run_end.serving_real(self._plan, reported - self.forgotten.keys())
        if alive - serving:
            self._users_ended_at = None
            return serving
        self._users_ended_at = now if self._users_ended_at is None else self._users_ended_at
        return serving if now - self._users_ended_at < SETTLE_S else frozenset()
