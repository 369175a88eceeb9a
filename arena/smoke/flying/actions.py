"""Carries out what a scenario does to its arena: signals by recorded pid, faults into the rooms' sockets, what a pilot would ask.

Nothing here waits: a deed is done while time stands still, and what comes of it is for the scenario to look at.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from arena.errors import RunError
from arena.fault_injection import Fault, inject
from arena.plan.model import Plan, VehiclePlan
from arena.run_dirs import RUNTIME_DIR_VARIABLE
from arena.smoke.flying.run_log import RunLog
from arena.smoke.flying.telemetry_listener import TelemetryListener
from arena.smoke.language.model import Deed
from arena.supervisor import Control, proc_fs
from arena.wire.px4_mode import mode_numbers

_SIGNALS = {"kill": signal.SIGKILL, "hang": signal.SIGSTOP, "resume": signal.SIGCONT}
_PANIC = {
    "land all": ("arena.emergency.land_all",),
    "kill all": ("arena.cli", "kill-all", "--yes"),
    "down": ("arena.cli", "down"),
}
_DO_SET_MODE, _CUSTOM_MODE = 176, 1
_CONTROL_S = 0.5  # wall time; the world waits for a second for one who is awake


class ActionRunner:
    """Of one running arena. run: its run folder; rt: its runtime folder."""

    def __init__(self, plan: Plan, run: Path, rt: Path, chronicle: RunLog, ears: TelemetryListener) -> None:
        self._run, self._rt, self._chronicle, self._ears = run, rt, chronicle, ears
        self._vehicles = {v.name: v for v in plan.vehicles}
        self._commands: list[subprocess.Popen[bytes]] = []
        self._slices = {name.removesuffix(".json"): _slice(run, name) for name in plan.slices}

    def do(self, deed: Deed) -> None:
        """Raises RunError where it cannot be done."""
        if deed.verb in _SIGNALS or deed.verb == "restart":
            for process in deed.processes:
                with contextlib.suppress(RunError) if deed.undo else contextlib.nullcontext():
                    self._process("resume" if deed.undo else deed.verb, process)
        elif deed.verb == "mode":
            for vehicle in deed.vehicles:
                self._mode(vehicle, deed.word)
        elif deed.verb in ("land all", "kill all", "down"):
            self._panic(deed.verb)
        else:
            self._spoil(deed)

    # -- processes

    def _process(self, verb: str, process: str) -> None:
        if verb == "restart":
            control = Control(self._rt / "control.sock", _CONTROL_S)
            control.ask(do="restart", name=process)
            control.close()
            return
        member = self._chronicle.member(process)
        if member is None or not member.alive:
            raise RunError(f"{process} does not run")
        # All but the supervisor lead a group of their own; a PX4 is in that of the process that started it.
        for pid in [member.pid] if process == "supervisor" else proc_fs.group_members(member.pgid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, _SIGNALS[verb])

    # -- what a pilot or a person would ask

    def _mode(self, vehicle: str, word: str) -> None:
        main, sub = mode_numbers(word)
        self._ears.command(vehicle, _DO_SET_MODE, _CUSTOM_MODE, main, sub)

    def _panic(self, verb: str) -> None:
        """As a person does, by a command of its own; its words go into the run folder."""
        module, *words = _PANIC[verb]
        with (self._run / "logs" / f"{verb.replace(' ', '-')}.txt").open("ab") as out:
            self._commands.append(
                subprocess.Popen(
                    [sys.executable, "-m", module, *words, "--run", str(self._run)],
                    stdout=out,
                    stderr=subprocess.STDOUT,
                    stdin=subprocess.DEVNULL,
                    env={**os.environ, RUNTIME_DIR_VARIABLE: str(self._rt.parent)},
                    start_new_session=True,
                )
            )

    @property
    def commanding(self) -> bool:
        """A command that a person would have typed is still at work: it lives on wall time."""
        return any(command.poll() is None for command in self._commands)

    # -- faults

    def _spoil(self, deed: Deed) -> None:
        for vehicle in deed.vehicles if deed.verb == "battery drain" else ():
            if self._vehicles[vehicle].autopilot != "builtin":
                self._ears.set_parameter(
                    vehicle, "SIM_BAT_DRAIN", self._drain_s(vehicle) if deed.undo else max(1.0, deed.number)
                )
        for room, fault in faults(deed, self._vehicles, self._slices.get("world", {})):
            path = self._slices.get(room, {}).get("faults")
            if not path:
                raise RunError(f"{room} of this arena takes no faults")
            inject(path, fault)

    def _drain_s(self, vehicle: str) -> float:
        return float(self._slices.get(f"px4.{vehicle}", {}).get("params", {}).get("SIM_BAT_DRAIN", 60.0))


def faults(
    deed: Deed, vehicles: Mapping[str, VehiclePlan], world: Mapping[str, Any]
) -> list[tuple[str, Fault]]:
    """(room, fault) of a deed or of its taking back. vehicles: all of the arena, by name. world: its slice."""
    hit = [vehicles[name] for name in deed.vehicles]
    if deed.verb in _AT_ONCE:
        room, made = _AT_ONCE[deed.verb]
        return [(room, made(deed, hit, world))]
    room, each = _EACH[deed.verb]
    return [(room, each(deed, v)) for v in hit if deed.verb != "battery drain" or v.autopilot == "builtin"]


_STILL = [0.0, 0.0, 0.0]
_AT_ONCE: dict[str, tuple[str, Callable[[Deed, list[VehiclePlan], Mapping[str, Any]], Fault]]] = {
    "wind": (
        "world",
        lambda d, _, world: {
            "do": "wind",
            "wind_m_s": list(world.get("wind_m_s", _STILL) if d.undo else d.by),
        },
    ),
    "mocap swap": (
        "mocap",
        lambda d, hit, _: {"do": "swap", "bodies": [v.mocap_body for v in hit], "on": not d.undo},
    ),
    "mocap delay": ("mocap", lambda d, *_: {"do": "delay", "ms": 0.0 if d.undo else d.number}),
    "ground station loss": ("router", lambda d, *_: {"do": "heartbeat", "on": d.undo}),
}
_EACH: dict[str, tuple[str, Callable[[Deed, VehiclePlan], Fault]]] = {
    "mocap dropout": ("mocap", lambda d, v: {"do": "dropout", "body": v.mocap_body, "on": not d.undo}),
    "mocap freeze": ("mocap", lambda d, v: {"do": "freeze", "body": v.mocap_body, "on": not d.undo}),
    "mocap jump": (
        "mocap",
        lambda d, v: {
            "do": "jump",
            "body": v.mocap_body,
            "by_m": _STILL if d.undo else list(d.by),
            "yaw_deg": 0.0,
        },
    ),
    "link loss": (
        "router",
        lambda d, v: {"do": "loss", "vehicle": v.name, "share": 0.0 if d.undo else d.number},
    ),
    "link delay": (
        "router",
        lambda d, v: {"do": "delay", "vehicle": v.name, "ms": 0.0 if d.undo else d.number},
    ),
    "rc loss": ("world", lambda d, v: {"do": "sticks", "vehicle": v.name, "on": d.undo}),
    "motor loss": (
        "world",
        lambda d, v: {
            "do": "motor",
            "vehicle": v.name,
            "rotor": int(d.number) or 1,
            "thrust": 1.0 if d.undo else 0.0,
        },
    ),
    "battery drain": (
        "world",
        lambda d, v: {"do": "battery", "vehicle": v.name, "empty_in_s": None if d.undo else d.number},
    ),
}


def _slice(run: Path, name: str) -> dict[str, Any]:
    """As the supervisor has filled it in."""
    try:
        found: dict[str, Any] = json.loads((run / "slices" / name).read_text())
    except (OSError, ValueError):
        return {}
    return found
