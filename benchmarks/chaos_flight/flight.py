"""One flight of two real vehicles with random faults: takes off, applies the faults, ends the run, and observes."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from arena.supervisor import open_run
from benchmarks.chaos_flight.faults import FLIGHT_S, VEHICLES, Fault, Script
from benchmarks.chaos_flight.radio import Radio
from benchmarks.chaos_flight.verdict import Observed, landed_names, violations
from tests.end_to_end.flight import PROGRAMS, Flight, Hangar
from tests.end_to_end.posing import PosingRoom, PosingVehicle

_PORT = 14540
_LATE_S, _PERMIT_AFTER_S = 6.0, 4.0
_READY_S = 60.0
_END_S = 90.0
_FORGET_AFTER_S = 12.0
_TICK_S = 0.05


@dataclass(frozen=True, kw_only=True)
class Result:
    """Result of one flight. why: violated rules; empty if all were kept. took_off: vehicles that were armed."""

    script: Script
    why: tuple[str, ...]
    took_off: int
    forgotten: tuple[str, ...]
    exit_code: int | None
    lasted_s: float


def arena_yaml(folder: Path, address: str, server: str) -> Path:
    """Write the YAML of an arena with two real vehicles."""
    lines = [
        "name: chaos",
        f"address: {address}",
        "world: {size: [14, 6, 3]}",
        f"mocap: {{source: natnet, server: {server}}}",
        "preflight: {params: false}",
        "copilot: {}",
        f"defaults: {{program: {{path: '{PROGRAMS / 'fly.py'}', args: [hovers]}}}}",
        "vehicles:",
    ]
    for i, name in enumerate(VEHICLES):
        lines.append(
            f"  {name}: {{autopilot: hardware, profile: iris, radio: none, url: 'udpin:{address}:{_PORT + i}'}}"
        )
    file = folder / "arena.yaml"
    file.write_text("\n".join(lines) + "\n")
    return file


class ChaosFlight:
    """Flight with the faults of a script. Call `fly` once.

    hangar: starts the arena on its address. room_address: address of the stand-ins for vehicles and cameras.
    """

    def __init__(self, script: Script, hangar: Hangar, room_address: str) -> None:
        self._script, self._hangar, self._room_address = script, hangar, room_address
        self._room: PosingRoom | None = None
        self._radios: dict[str, Radio] = {}
        self._observed = {name: Observed(name=name) for name in VEHICLES}
        self._undo: list[tuple[float, Fault]] = []
        self._runs: list[subprocess.Popen[str]] = []
        self._checked: set[int] = set()
        self._forgotten: list[str] = []
        self._permitted = False

    def fly(self) -> Result:
        """Fly, and return the result."""
        began = time.monotonic()
        try:
            self._set_up()
            flight = self._flight
            took_off = self._until_up()
            self._apply_faults(time.monotonic())
            self._end(flight)
            self._observe(flight)
        finally:
            self._tear_down()
        return Result(
            script=self._script,
            why=tuple(violations(self._observed.values())),
            took_off=took_off,
            forgotten=tuple(self._forgotten),
            exit_code=flight.process.poll(),
            lasted_s=time.monotonic() - began,
        )

    def _set_up(self) -> None:
        address, room = self._hangar.address, self._room_address
        vehicles = [
            PosingVehicle(
                name=name, number=i + 1, position=[-2.0 + 4.0 * i, 0.0, 0.0], partner=(room, 15000 + i)
            )
            for i, name in enumerate(VEHICLES)
        ]
        self._room = PosingRoom(room, *vehicles)
        for i, name in enumerate(VEHICLES):
            radio = self._radios[name] = Radio(
                system=i + 1,
                vehicle=self._room.links[name],
                near=(room, 15000 + i),
                own=(room, 15100 + 10 * i),
                arena=(address, _PORT + i),
                uid=f"airframe {i + 1}".encode(),
            )
            radio.cut = name == self._script.late
            radio.start()
        yaml = arena_yaml(self._hangar.folder, address, room)
        self._flight: Flight = self._hangar.up(yaml, "--yes")

    def _until_up(self) -> int:
        """Wait until the vehicles are armed, at most _READY_S; a late vehicle joins. Return the number of armed vehicles."""
        began = time.monotonic()
        while time.monotonic() - began < _READY_S:
            self._join_late(time.monotonic() - began)
            late = self._script.late if self._permitted else ""
            wanted = [radio for name, radio in self._radios.items() if name != late]
            if all(radio.state.armed and radio.state.landed is False for radio in wanted):
                break
            if self._flight.process.poll() is not None:
                break
            time.sleep(_TICK_S)
        return sum(radio.state.was_armed for radio in self._radios.values())

    def _join_late(self, since_s: float) -> None:
        """Switch on the late vehicle, and some seconds later permit it to arm. since_s: time since the start [s]."""
        late = self._script.late
        if not late or since_s < _LATE_S or self._permitted:
            return
        self._radios[late].cut = False
        if since_s >= _LATE_S + _PERMIT_AFTER_S:
            self._permitted = True
            self._observed[late].armed_without_permit = self._radios[late].state.was_armed
            self._command("arm-permit", late)

    # -- faults

    def _apply_faults(self, began: float) -> None:
        todo = list(self._script.faults)
        while (now := time.monotonic()) < began + FLIGHT_S:
            while todo and now - began >= todo[0].at:
                self._apply(todo.pop(0), now)
            self._undo_due(now)
            time.sleep(_TICK_S)

    def _apply(self, fault: Fault, now: float) -> None:
        radio, room = self._radios.get(fault.target), self._room
        if fault.for_s and fault.what != "pilot":
            self._undo.append((now + fault.for_s, fault))
        if radio is not None:
            _apply_to_radio(fault, radio)
        match fault.what:
            case "kill" | "pause":
                self._signal(fault.target, signal.SIGKILL if fault.what == "kill" else signal.SIGSTOP)
            case "restart":
                self._command("restart", fault.target, "--yes")
            case "swap bodies" if room is not None:
                room.inject("mocap", {"do": "swap", "bodies": list(VEHICLES), "on": True})
            case "delete the run folder":
                shutil.rmtree(self._flight.folder / "logs", ignore_errors=True)
            case "land-all":
                self._command("land-all")

    def _undo_due(self, now: float, *, everything: bool = False) -> None:
        due = [(at, fault) for at, fault in self._undo if everything or now >= at]
        self._undo = [pair for pair in self._undo if pair not in due]
        for _, fault in due:
            radio = self._radios.get(fault.target)
            match fault.what:
                case "pause":
                    self._signal(fault.target, signal.SIGCONT)
                case "unplug" | "stranger" if radio is not None:
                    radio.send_stranger_home()
                    radio.cut = False
                case "swap bodies" if self._room is not None:
                    self._room.inject("mocap", {"do": "swap", "bodies": list(VEHICLES), "on": False})

    def _signal(self, process: str, number: int) -> None:
        state = open_run(self._flight.folder)
        if state is not None and process in state.processes:
            with contextlib.suppress(ProcessLookupError):
                os.kill(state.processes[process].pid, number)

    def _command(self, *arguments: str) -> None:
        self._runs.append(self._flight.start_cli(*arguments))

    # -- the end

    def _end(self, flight: Flight) -> None:
        """End the run as the script says, and wait until all its processes have ended."""
        signals = {"Ctrl-C": signal.SIGINT, "SIGTERM": signal.SIGTERM, "SIGHUP": signal.SIGHUP}
        end = self._script.end
        if end in signals:
            flight.signal(signals[end])
        elif end == "supervisor killed":
            flight.signal(signal.SIGKILL)
            self._command("land-all", "--run", str(flight.folder))
        else:
            for _ in range(2 if end == "two land-all" else 1):
                self._command(*(("down",) if end == "arena down" else ("land-all",)))
        began = time.monotonic()
        down = end in ("arena down", *signals, "supervisor killed")
        while (now := time.monotonic()) < began + _END_S:
            self._undo_due(now)
            self._check_landings()
            if not down and all(run.poll() is not None for run in self._runs):
                down = True
                self._command("down")
            if flight.process.poll() is not None and not flight.processes():
                break
            if now > began + _FORGET_AFTER_S:
                self._forget_unplugged(flight)
            time.sleep(_TICK_S)
        self._check_landings()

    def _forget_unplugged(self, flight: Flight) -> None:
        """Do what an operator does with a vehicle that sends nothing any more."""
        for name, radio in self._radios.items():
            if radio.cut and name not in self._forgotten and flight.process.poll() is None:
                self._forgotten.append(name)
                self._observed[name].declared = True
                self._command("forget", name, "--yes")

    def _check_landings(self) -> None:
        """Compare what ended commands and the ended run say with what the vehicles really do."""
        for run in self._runs:
            if run.poll() is not None and id(run) not in self._checked:
                self._checked.add(id(run))
                self._compare(run.stdout.read() if run.stdout is not None else "")

    def _compare(self, text: str) -> None:
        for name in landed_names(text) & set(self._radios):
            if self._radios[name].state.armed:
                self._observed[name].false_landings.append(text[-200:])

    def _observe(self, flight: Flight) -> None:
        if flight.process.poll() is not None:
            self._compare(flight.said())
        for name, radio in self._radios.items():
            own = self._observed[name]
            own.armed_at_end, own.flew = radio.state.armed, radio.state.was_armed
            if radio.pilot is not None:
                own.pilot_since, own.pilot_until = radio.pilot.reported_at, radio.pilot.until
            own.received, own.to_stranger = tuple(radio.received), tuple(radio.to_stranger)

    def _tear_down(self) -> None:
        self._undo_due(0.0, everything=True)
        for run in self._runs:
            if run.poll() is None:
                run.kill()
            run.wait()
        self._hangar.close()
        for radio in self._radios.values():
            radio.close()
        if self._room is not None:
            self._room.__exit__(None, None, None)


def _apply_to_radio(fault: Fault, radio: Radio) -> None:
    if fault.what in ("unplug", "stranger"):
        radio.cut = True
        if fault.what == "stranger":
            radio.bring_stranger()
    elif fault.what == "pilot" and radio.pilot is None and radio.state.armed:
        radio.take_over(fault.for_s)
