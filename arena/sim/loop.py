"""The world's step loop: steps autopilots and bodies, and exchanges data with sockets and shared memory.

It is the only module of this package that uses sockets and the wall clock.
One step with built-in autopilots: wait, read the links, sample the sensors, step the autopilots, step the
bodies, publish the true state, send the autopilots' messages, publish the time. So a client that the new time
wakes finds the state and the messages of this time.

One step with autopilots in processes of their own (PX4): sample and send the sensors, wait for the clock's
clients, read the links, publish true state, messages and time, collect the motor commands, step the bodies. So
the autopilots compute while this process publishes. Messages of built-in autopilots are sent in the next step.

In both cases the published time does not change while a client of the clock is awake. A fault that such a
client injects takes effect in the next step. With autopilots in processes of their own it takes effect one
step later, because that step has already begun.
"""

from __future__ import annotations

import gc
import math
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from arena.clock_server import ClockServer
from arena.errors import InputError, RunError
from arena.fault_injection import FaultReceiver
from arena.process_context import SUPERVISOR_LOST, ProcessContext, ShutdownPolicy
from arena.sim.autopilot_interface import ExternalAutopilots, MakeAutopilots
from arena.sim.fault_injection import inject_fault
from arena.sim.pacing import Pacer, own_core
from arena.sim.vehicle_links import LinkInterface
from arena.sim.world import World
from arena.simulation_speed import speed_of
from arena.socket_watch import SocketWatch
from arena.wire.truth_page import TruthWriter

_CHECK_S = 0.1  # between two checks of the supervisor and of new events
_STATS_S = 1.0
_FULL_SEARCH_S = 60.0  # between two searches for garbage among all objects
_DRAIN_SHARE = 0.3  # largest share of a period's wall time for reading the links
_MAX_WAIT_S = 0.1
_MILLI_S = 1e-3
_RTF_TOLERANCE = 0.02
_JOIN_TIMEOUT_S = 30.0
_AFTER_DONE_S = 2.0
_LAST_STEPS_S = 3.0
MakeLinks = Callable[[ProcessContext, Mapping[str, Any], float, SocketWatch, ClockServer], LinkInterface]
"""Opens the links of all vehicles: (context, settings of the world, wall time for reading in one step [s], watch of their sockets,
server of the simulation clock).

The world polls the watch directly before each call of `LinkInterface.drain`."""


class Loop:
    """Step loop of the simulated world. It opens sockets and shared memory pages, and removes them at the end.

    `run` returns if a stop is requested, or when the `ShutdownPolicy` ends the process.

    settings: configuration of the world.  make_links: opens the links of the vehicles.
    """

    def __init__(
        self,
        context: ProcessContext,
        settings: dict[str, Any],
        make_autopilots: MakeAutopilots,
        make_links: MakeLinks,
    ) -> None:
        self._context, self._speed = context, speed_of(settings.get("speed", 1.0))
        self._world = World(settings)
        self._autopilots = make_autopilots(settings, self._world.period_s)
        self._external = self._autopilots if isinstance(self._autopilots, ExternalAutopilots) else None
        period_s = self._world.period_s
        if math.isfinite(self._speed):
            period_s /= max(self._speed, 1.0)
        self._keep_to_a_core(settings["vehicles"])
        self._truth_path = Path(settings["truth"])
        self._truth, self._clock = self._pages(settings["clock"])
        self._truth.follow(self._world.live_truth())
        self._watch = SocketWatch()
        self._watch.add(self._clock.fileno())
        try:
            self._links = make_links(context, settings, _DRAIN_SHARE * period_s, self._watch, self._clock)
        except BaseException:
            self._close_pages()
            raise
        self._unsent: list[tuple[int, str, bytes]] = []
        self._expected = frozenset(settings.get("expected", ()))
        self._ended: set[str] = set()  # programs that have ended, as the supervisor reports
        self._ready = False
        self._until_done = self._last_steps = False
        self._done_at = math.inf  # simulation time [s]
        self._stop_by = math.inf  # wall time [s]
        self._faults = self._listen(settings.get("faults"))
        self._watch.add(self._faults.fileno())
        self._shutdown = ShutdownPolicy()
        self._clients_dropped = 0

    def run(self) -> None:
        """Run steps of the world until the process must end."""
        if self._external is None:  # else the step itself begins with publishing
            self._truth.append(self._world.now)
            self._clock.tick(self._world.now)
        self._step()
        # All objects created so far live as long as the process, so the garbage collector can skip them.
        gc.collect()
        gc.freeze()
        gc.disable()
        self._serve()

    def close(self) -> None:
        """Close all sockets and remove the shared memory pages."""
        self._watch.close()
        self._faults.close()
        self._links.close()
        if (close := getattr(self._autopilots, "close", None)) is not None:
            close()
        self._close_pages()
        self._world.close()

    def _close_pages(self) -> None:
        self._clock.close()
        self._truth_path.unlink(missing_ok=True)

    def _keep_to_a_core(self, vehicles: list[dict[str, Any]]) -> None:
        external = sum(v.get("autopilot", "builtin") != "builtin" for v in vehicles)
        core = own_core(tuple(os.sched_getaffinity(0)), speed=self._speed, external=external, pid=os.getpid())
        if core is not None:
            os.sched_setaffinity(0, {core})

    def _pages(self, clock: str) -> tuple[TruthWriter, ClockServer]:
        try:
            return (
                TruthWriter(self._truth_path, self._world.fleet.size, period_s=self._world.period_s),
                ClockServer(clock, lockstep=self._speed != 1.0),
            )
        except OSError as error:
            for page in (self._truth_path, Path(f"{clock}.page"), Path(f"{clock}.sock")):
                page.unlink(missing_ok=True)
            raise RunError(
                f"cannot publish the true state at {self._truth_path} and the simulation time at {clock}: {error}"
            ) from error

    def _listen(self, path: str | None) -> FaultReceiver:
        try:
            return FaultReceiver(path)
        except RunError:
            self._close_pages()
            raise

    def _serve(self) -> None:
        now = time.monotonic()
        pacer = Pacer(period_s=self._world.period_s, speed=self._speed, now=now)
        next_check, next_stats, next_search = now, now + _STATS_S, now + _FULL_SEARCH_S
        while not self._must_stop():
            now = self._wait(pacer)
            if not self._is_over():
                pacer.begin(now)
                self._step()
            if not self._ready and self._links.ready:
                self._ready = True
                self._context.ready()
                self._until_clients_join()
            if now >= next_check:
                next_check = now + _CHECK_S
                if self._check(now):
                    break
            if now >= next_stats:
                next_stats = now + _STATS_S
                self._context.stats(self._stats(pacer))
                self._log_pace(pacer)
                if now >= next_search:
                    next_search = now + _FULL_SEARCH_S
                    gc.unfreeze()
                gc.collect()
                gc.freeze()  # so that the next search looks only at new objects
        self._check(now)
        self._context.stats(self._stats(pacer))

    def _step(self) -> None:
        world, autopilots = self._world, self._autopilots
        if self._external is None:
            self._read_sockets()
            world.step(autopilots.step(world.now, world.sense()))
            self._truth.append(world.now)
            self._links.send(autopilots.transmit(), world.now)
            self._clock.tick(world.now, poll=self._speed == 1.0)
        else:
            truth = world.live_truth()  # it does not change before `advance`
            self._external.receive_truth(truth)
            self._external.begin(world.now, world.sense(self._external.requested))
            world.observe()
            self._until_clients_sleep()
            self._read_sockets()
            self._truth.append(world.now)
            self._links.send(self._unsent, world.now)
            self._clock.tick(world.now, poll=self._speed == 1.0)
            world.advance(self._external.finish())
            self._unsent = autopilots.transmit()

    def _read_sockets(self) -> None:
        """Read the datagrams, clock requests and faults that have arrived.

        The datagrams of a program are read in the first step after it was awake, those of others up to 0.5 ms later. Autopilots in
        processes of their own can send in every step.
        """
        if self._external is None:
            self._watch.poll_if_due(time.monotonic(), self._clock.wakes)
        else:
            self._watch.poll()
        if self._watch.has_data(self._clock.fileno()):
            self._clock.poll()
        self._links.drain(self._autopilots.receive)
        if self._watch.has_data(self._faults.fileno()):
            self._inject_faults()

    def _inject_faults(self) -> None:
        """Apply the injected faults that have arrived."""
        for text in self._faults.apply(lambda fault: inject_fault(self._world, self._autopilots, fault)):
            self._context.event(text)

    def _until_clients_sleep(self) -> None:
        """Wait until all programs on the simulation clock have finished their work for the current time.

        At speed 1 (real time), return at once. During the wait, faults are injected and the datagrams of the panic links, which
        are reserved for emergencies, reach the autopilots.
        """
        if self._speed == 1.0:
            return
        while not (self._clock.may_advance(self._world.now, time.monotonic()) or self._context.stopping):
            if not self._clock.wait_for_requests(_MILLI_S):
                self._inject_faults()  # the socket's buffer holds only a few
                self._serve_panic_links()

    def _until_clients_join(self) -> None:
        """Wait until all expected programs use the simulation clock, so that they start at the same simulation time.

        The wait ends early for programs that have ended, and for all programs when a datagram arrives on a panic link: a
        landing needs simulation time. A program that never uses the clock is not waited for longer than 30 s of wall time.
        """
        text, end = "", time.monotonic() + _JOIN_TIMEOUT_S
        while missing := ", ".join(sorted(self._expected - self._clock.joined - self._ended)):
            now = time.monotonic()
            if self._context.stopping or self._check(now) or self._context.orphaned:
                return
            if now > end:
                text = f"{missing}: has not slept on the simulation clock within {_JOIN_TIMEOUT_S:g} s, so this flight is not repeatable"
            elif self._serve_panic_links():
                text = f"{missing}: not waited for, because a command has arrived on a panic link, so this flight is not repeatable"
            if text:
                self._context.event(text)
                return
            self._clock.poll(_MAX_WAIT_S)

    def _serve_panic_links(self) -> bool:
        """Pass datagrams of the panic links (for land-all, kill-all, copilot) to the autopilots, and send the replies.

        The world calls this while simulation time stands still. Return whether a datagram had arrived.
        """
        arrived = self._links.drain_panic(self._autopilots.receive)
        if arrived:
            self._links.send(self._autopilots.transmit(), self._world.now)
        return arrived

    def _must_stop(self) -> bool:
        """Return whether the step loop must end because of a stop signal.

        If all programs have ended before the signal, the loop first runs until the simulation time at which `_is_over` is true,
        for at most 3 s of wall time. With `--until-done` the supervisor sends the signal only after this simulation time.
        """
        if not self._context.stopping:
            return False
        now = time.monotonic()
        self._stop_by = min(self._stop_by, now + _LAST_STEPS_S)
        return self._done_at == math.inf or self._is_over() or now > self._stop_by

    def _is_over(self) -> bool:
        """Return whether simulation time must stop, because all programs ended at least 2 s ago.

        Only with `arena up --until-done`, in a world that waits for its programs: repeated flights then end at the same time.
        The supervisor reads from `last_steps` whether this time is still to come.
        """
        if not (self._until_done and self._expected):
            return False
        if self._done_at == math.inf:
            if not self._expected.isdisjoint(self._clock.asleep):
                return False  # that program has not ended
            if not all(map(self._is_finished, self._expected)):
                return False
            self._done_at = math.inf if np.any(self._autopilots.armed) else self._world.now
        if self._world.now < self._done_at + _AFTER_DONE_S:
            return False
        self._report_last_steps(False)
        self._clock.poll(_MILLI_S)
        return True

    def _report_last_steps(self, to_come: bool) -> None:
        """Report to the supervisor whether steps remain until the simulation time at which the flight must end."""
        if to_come != self._last_steps:
            self._last_steps = to_come
            self._context.stats({"last_steps": to_come})

    def _is_finished(self, program: str) -> bool:
        """Return whether a program has disconnected from the simulation clock, or has ended without using it."""
        clock = self._clock
        return clock.has_disconnected(program) or (program in self._ended and program not in clock.joined)

    def _wait(self, pacer: Pacer) -> float:
        """Wait until the next step may begin, and return the wall time [s]."""
        now = time.monotonic()
        while (left := pacer.wait_s(now)) > 0.0 and not self._context.stopping:
            self._idle(min(left, _MAX_WAIT_S))
            now = time.monotonic()
        if self._external is None:
            self._until_clients_sleep()
            now = time.monotonic()
        return now

    def _idle(self, left_s: float) -> None:
        """Wait for `left_s` of wall time. Meanwhile, process requests to the simulation clock.

        Sleep during the last milliseconds, because sleeping is more precise.
        """
        if left_s > 2.0 * _MILLI_S:
            self._clock.poll((math.floor(left_s / _MILLI_S) - 1) * _MILLI_S)
        else:
            time.sleep(left_s)

    def _check(self, now: float) -> bool:
        """Log new events and pass on the supervisor's requests. Return whether the process must end.

        It must end if the supervisor has died and no vehicle needs this world any more.
        """
        for text in (*self._world.events(), *self._autopilots.events(), *self._dropped_clients()):
            self._context.event(text)
            print(text, flush=True)  # the log exists when the supervisor does not
        for request in self._context.requests():
            self._on_request(request)
            self._autopilots.on_request(request)
            self._links.on_request(request)
            self._context.confirm(request)
        orphaned = self._context.orphaned
        if orphaned:
            self._autopilots.on_request(SUPERVISOR_LOST)
            self._links.on_request(SUPERVISOR_LOST)
        return self._shutdown.over(orphaned=orphaned, any_armed=bool(np.any(self._autopilots.armed)), now=now)

    def _on_request(self, request: Mapping[str, Any]) -> None:
        """Process a request of the supervisor: `until_done` (stop time after all programs) or `program_ended`."""
        match request.get("do"):
            case "until_done":
                self._until_done = True
                self._report_last_steps(bool(self._expected))
            case "program_ended":
                self._ended.add(str(request.get("program")))

    def _log_pace(self, pacer: Pacer) -> None:
        """Log a line if the real-time factor of the last second differs from the requested factor."""
        if math.isfinite(self._speed) and abs(pacer.rtf / self._speed - 1.0) > _RTF_TOLERANCE:
            rtf = f"real-time factor {pacer.rtf:.3f}, requested {self._speed:g}"
            print(f"at {self._world.now:.1f} s of simulation time: {rtf} (over the last second)", flush=True)

    def _dropped_clients(self) -> list[str]:
        names = self._clock.dropped[self._clients_dropped :]
        self._clients_dropped += len(names)
        return [
            f"{name} has not waited on the simulation clock for 1 s: the world no longer waits for it"
            for name in names
        ]

    def _stats(self, pacer: Pacer) -> dict[str, Any]:
        return {
            **pacer.stats(),
            "steps": self._world.steps,
            "sim_time_s": round(self._world.now, 3),
            "links": self._links.stats(),
            "vehicles": self._world.flights(),
            "autopilot": self._autopilots.stats(),
        }


def run(
    context: ProcessContext, settings: dict[str, Any], make_autopilots: MakeAutopilots, make_links: MakeLinks
) -> None:
    """Run the world with given MAVLink links until a stop is requested. Raises ArenaError.

    The arguments are those of `Loop`.
    """
    try:
        loop = Loop(context, settings, make_autopilots, make_links)
    except KeyError as error:
        raise InputError(
            f"configuration file of {context.name}: the key {error} is missing. "
            "`arena up` writes this file; its keys are in docs/reference/slices.md"
        ) from error
    try:
        loop.run()
    finally:
        loop.close()
