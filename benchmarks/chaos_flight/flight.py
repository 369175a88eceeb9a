"""One flight of two real vehicles with random faults: takes off, applies the faults, ends the run, and observes."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path
from threading import Thread

from arena.supervisor import open_run
from benchmarks.chaos_flight.disk import SmallDisk
from benchmarks.chaos_flight.faults import FLIGHT_S, VEHICLES, Fault, Script
from benchmarks.chaos_flight.radio import Radio
from benchmarks.chaos_flight.record import Record, Strike
from benchmarks.chaos_flight.verdict import Observed, landed_names, violations
from tests.end_to_end.flight import PROGRAMS, Flight, Hangar
from tests.end_to_end.posing import PosingRoom, PosingVehicle

_PORT = 14540
_LATE_S, _PERMIT_AFTER_S = 6.0, 4.0
_READY_S = 60.0
_END_S = 90.0
_FORGET_AFTER_S = 12.0
_TICK_S = 0.05


def arena_yaml(folder: Path, address: str, server: str) -> Path:
    """Write the YAML of an arena with two real vehicles."""
    lines = [
        "name: chaos",
        f"address: {address}",
        "world: {size: [14, 6, 3]}",
        f"mocap: {{source: natnet, server: {server}}}",
        "preflight: {params: false, axes_check: none}",
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
    disk: disk of the run folder, for faults of the disk; None if the system allows none.
    """

    def __init__(
        self, script: Script, hangar: Hangar, room_address: str, disk: SmallDisk | None = None
    ) -> None:
        self._script, self._hangar, self._room_address = script, hangar, room_address
        self._disk = disk
        self._room: PosingRoom | None = None
        self._radios: dict[str, Radio] = {}
        self._observed = {name: Observed(name=name) for name in VEHICLES}
        self._undo: list[tuple[float, Fault]] = []
        self._runs: list[subprocess.Popen[str]] = []
        self._checked: set[int] = set()
        self._forgotten: list[str] = []
        self._permitted = False
        self._strikes: list[Strike] = []
        self._landed: set[str] = set()

    def fly(self) -> Record:
        """Fly, and return the record."""
        began = time.monotonic()
        try:
            self._set_up()
            flight = self._flight
            took_off = self._until_up()
            _ = flight.folder  # a full disk may leave no file that marks it
            self._apply_faults(time.monotonic())
            ended = self._end(flight)
            self._observe(flight)
        finally:
            self._tear_down()
        states = [radio.state for radio in self._radios.values()]
        return Record(
            seed=self._script.seed,
            script=str(self._script),
            late=self._script.late,
            end=self._script.end,
            why=tuple(violations(self._observed.values(), ended=ended)),
            took_off=took_off,
            airborne=sum(state.was_airborne for state in states),
            strikes=tuple(self._strikes),
            takeovers=sum(own.pilot_since is not None for own in self._observed.values()),
            landed=len(self._landed),
            forgotten=tuple(self._forgotten),
            restarts=_restarts(flight),
            exit_code=flight.process.poll(),
            lasted_s=round(time.monotonic() - began, 1),
        )

    def _set_up(self) -> None:
        address, room = self._hangar.address, self._room_address
        self._flight: Flight = self._hangar.up(
            arena_yaml(self._hangar.folder, address, room), "--yes", "--no-report"
        )  # loads while the room starts
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
            armed = self._radios[late].state.was_armed
            granted = f"{late}: arm permit granted" in self._flight.said()  # by the confirmation of the start
            self._observed[late].armed_without_permit = armed and not granted
            self._command("arm-permit", late)

    # -- faults

    def _apply_faults(self, began: float) -> None:
        todo = list(self._script.faults)
        while (now := time.monotonic()) < began + FLIGHT_S:
            while todo and now - began >= todo[0].at:
                self._strike(todo.pop(0), now, began)
            self._undo_due(now)
            time.sleep(_TICK_S)

    def _strike(self, fault: Fault, now: float, began: float) -> None:
        airborne = self._is_airborne(fault.target)
        worked = self._apply(fault)
        if worked and fault.for_s and fault.what != "pilot":
            self._undo.append((now + fault.for_s, fault))
        self._strikes.append(
            Strike(
                what=fault.what,
                target=fault.target,
                at=round(now - began, 2),
                airborne=airborne,
                worked=worked,
            )
        )

    def _is_airborne(self, target: str) -> bool:
        """Return whether a vehicle or the vehicle of a process is in the air; for everything else, whether any vehicle is."""
        named = [radio for name, radio in self._radios.items() if target.endswith(name)]
        states = [radio.state for radio in named or self._radios.values()]
        return any(state.armed and state.landed is False for state in states)

    def _apply(self, fault: Fault) -> bool:
        """Carry out a fault. Return False if this was not possible, for example because the process has ended."""
        radio, room, disk = self._radios.get(fault.target), self._room, self._disk
        match fault.what:
            case "unplug" | "stranger" | "pilot" if radio is not None:
                return _apply_to_radio(fault, radio)
            case "kill" | "pause":
                return self._signal(fault.target, signal.SIGKILL if fault.what == "kill" else signal.SIGSTOP)
            case "restart":
                self._command("restart", fault.target, "--yes")
            case "swap bodies" if room is not None:
                room.inject("mocap", {"do": "swap", "bodies": list(VEHICLES), "on": True})
            case "delete the run folder":
                logs = self._flight.folder / "logs"
                if (disk is not None and disk.hung) or not logs.exists():
                    return False
                shutil.rmtree(logs, ignore_errors=True)
            case "land-all":
                self._command("land-all")
            case "full disk":
                return disk is not None and not disk.hung and disk.fill()
            case "hung disk":
                return disk is not None and disk.hang()
        return True

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
                case "full disk" if self._disk is not None:
                    Thread(target=self._disk.free, daemon=True).start()  # the disk may hang
                case "hung disk" if self._disk is not None:
                    self._disk.go_on()

    def _signal(self, process: str, number: int) -> bool:
        """Send a signal to a process of the run. Return False if it does not run."""
        state = open_run(self._flight.folder)
        if state is None or process not in state.processes:
            return False
        with contextlib.suppress(ProcessLookupError):
            os.kill(state.processes[process].pid, number)
            return True
        return False

    def _command(self, *arguments: str) -> None:
        self._runs.append(self._flight.start_cli(*arguments))

    # -- the end

    def _end(self, flight: Flight) -> bool:
        """End the run as the script says, and wait until all its processes have ended. Return whether they have."""
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
                self._check_landings()
                return True
            if now > began + _FORGET_AFTER_S:
                self._forget_unplugged(flight)
            time.sleep(_TICK_S)
        self._check_landings()
        return False

    def _forget_unplugged(self, flight: Flight) -> None:
        """Do what an operator does with a vehicle that sends nothing any more.

        Declare it dead, or connect it again if there is no supervisor to declare it to.
        """
        for name, radio in self._radios.items():
            if radio.cut and flight.process.poll() is not None:
                radio.send_stranger_home()
                radio.cut = False
            elif radio.cut and name not in self._forgotten:
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
        self._landed |= landed_names(text)
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


def _apply_to_radio(fault: Fault, radio: Radio) -> bool:
    """Carry out a fault of the radio or of the pilot. Return False if the vehicle has a pilot already, or is disarmed."""
    if fault.what == "pilot":
        if radio.pilot is not None or not radio.state.armed:
            return False
        radio.take_over(fault.for_s)
        return True
    radio.cut = True
    if fault.what == "stranger":
        radio.bring_stranger()
    return True


def _restarts(flight: Flight) -> int:
    """Return how many restarts of processes the outcome reports; 0 if it could not be written."""
    try:
        return sum(int(process["restarts"]) for process in flight.outcome["processes"].values())
    except (OSError, ValueError):
        return 0
