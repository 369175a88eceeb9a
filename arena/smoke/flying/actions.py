"""Carries out the actions of a scenario (`do`): signals to processes, injected faults, vehicle commands.

No action waits for its effect, because simulation time stands still meanwhile. The scenario observes the effect later.
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
from arena.smoke.language.model import Action
from arena.supervisor import Control, proc_fs
from arena.wire.px4_mode import mode_numbers

_SIGNALS = {"kill": signal.SIGKILL, "hang": signal.SIGSTOP, "resume": signal.SIGCONT}
_EMERGENCY = {
    "land all": ("arena.emergency.land_all",),
    "kill all": ("arena.cli", "kill-all", "--yes"),
    "down": ("arena.cli", "down"),
}
_DO_SET_MODE, _CUSTOM_MODE = 176, 1
_CONTROL_S = 0.5  # wall time; below the 1 s that the world waits for its clients


class ActionRunner:
    """Carries out the actions of a scenario on one running arena.

    run: path of the run folder.
    rt: path of the runtime folder.
    """

    def __init__(self, plan: Plan, run: Path, rt: Path, run_log: RunLog, listener: TelemetryListener) -> None:
        self._run, self._rt, self._run_log, self._listener = run, rt, run_log, listener
        self._vehicles = {v.name: v for v in plan.vehicles}
        self._commands: list[subprocess.Popen[bytes]] = []
        self._slices = {name.removesuffix(".json"): _slice(run, name) for name in plan.slices}

    def do(self, action: Action) -> None:
        """Carry out an action of the scenario, or undo it if `action.undo` is set. Raises RunError on failure."""
        if action.verb in _SIGNALS or action.verb == "restart":
            for process in action.processes:
                with contextlib.suppress(RunError) if action.undo else contextlib.nullcontext():
                    self._process("resume" if action.undo else action.verb, process)
        elif action.verb == "mode":
            for vehicle in action.vehicles:
                self._mode(vehicle, action.mode)
        elif action.verb in ("land all", "kill all", "down"):
            self._run_emergency(action.verb)
        else:
            self._inject(action)

    # -- processes

    def _process(self, verb: str, process: str) -> None:
        if verb == "restart":
            control = Control(self._rt / "control.sock", _CONTROL_S)
            control.ask(do="restart", name=process)
            control.close()
            return
        member = self._run_log.member(process)
        if member is None or not member.alive:
            raise RunError(f"cannot {verb} {process}: this process has ended or was not started")
        # Every process except the supervisor has its own process group. PX4 is in the group of its process `px4.<v>`.
        for pid in [member.pid] if process == "supervisor" else proc_fs.group_members(member.pgid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, _SIGNALS[verb])

    # -- commands of a pilot or a person

    def _mode(self, vehicle: str, word: str) -> None:
        main, sub = mode_numbers(word)
        self._listener.command(vehicle, _DO_SET_MODE, _CUSTOM_MODE, main, sub)

    def _run_emergency(self, verb: str) -> None:
        """Start land-all, kill-all or `arena down` as a separate process.

        Its output is written into the run folder.
        """
        module, *words = _EMERGENCY[verb]
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
    def commands_running(self) -> bool:
        """True while a command such as `arena land-all` runs.

        This command uses wall time, so the simulation must not be faster than real time.
        """
        return any(command.poll() is None for command in self._commands)

    # -- faults

    def _inject(self, action: Action) -> None:
        for vehicle in action.vehicles if action.verb == "battery drain" else ():
            if self._vehicles[vehicle].autopilot != "builtin":
                self._listener.set_parameter(
                    vehicle,
                    "SIM_BAT_DRAIN",
                    self._drain_s(vehicle) if action.undo else max(1.0, action.number),
                )
        for room, fault in faults(action, self._vehicles, self._slices.get("world", {})):
            path = self._slices.get(room, {}).get("faults")
            if not path:
                raise RunError(
                    f"cannot inject a fault into the process {room}: slices/{room}.json has no key `faults`. Are all vehicles simulated?"
                )
            inject(path, fault)

    def _drain_s(self, vehicle: str) -> float:
        return float(self._slices.get(f"px4.{vehicle}", {}).get("params", {}).get("SIM_BAT_DRAIN", 60.0))


def faults(
    action: Action, vehicles: Mapping[str, VehiclePlan], world: Mapping[str, Any]
) -> list[tuple[str, Fault]]:
    """Return the faults that an action injects: (process that receives the fault, fault).

    If `action.undo` is set, return the faults that end its effect.

    vehicles: all vehicles of the arena, by name.
    world: JSON configuration (slice) of the world, with its initial wind.
    """
    hit = [vehicles[name] for name in action.vehicles]
    if action.verb in _AT_ONCE:
        room, made = _AT_ONCE[action.verb]
        return [(room, made(action, hit, world))]
    room, each = _EACH[action.verb]
    return [
        (room, each(action, v)) for v in hit if action.verb != "battery drain" or v.autopilot == "builtin"
    ]


_STILL = [0.0, 0.0, 0.0]
_AT_ONCE: dict[str, tuple[str, Callable[[Action, list[VehiclePlan], Mapping[str, Any]], Fault]]] = {
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
_EACH: dict[str, tuple[str, Callable[[Action, VehiclePlan], Fault]]] = {
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
    """Return the configuration (slice) of a process from the run folder, or {} if it cannot be read."""
    try:
        found: dict[str, Any] = json.loads((run / "slices" / name).read_text())
    except (OSError, ValueError):
        return {}
    return found
