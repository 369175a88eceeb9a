"""A stand-in for real vehicles and a vendor's motion capture: a simulated world on another loopback address.

Its MAVLink on UDP and its NatNet stream are what a real vehicle and a real server send.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from arena.fault_injection import inject
from arena.plan import make_plan
from arena.process_ties import set_death_signal
from arena.schema import load_arena
from arena.wire.truth_page import Truth, TruthReader

_end_with_us = partial(set_death_signal, signal.SIGKILL)
"""Lets the kernel kill this child process when the test process dies, because no supervisor ends it."""
NO_RADIO = {"COM_RC_IN_MODE": 4.0, "COM_RCL_EXCEPT": 4.0}
"""Parameters that a hardware vehicle without a radio must have, and a simulated one has not."""


@dataclass(frozen=True, kw_only=True)
class PosingVehicle:
    """Vehicle of a posing room.

    number: system id.
    position: start position [m] [NED].
    partner: address that its MAVLink is sent to.
    """

    name: str
    number: int
    position: list[float]
    partner: tuple[str, int]
    params: dict[str, float] = field(default_factory=dict)


class PosingRoom:
    """A world whose vehicles pose as real ones. Make it in the main thread: its processes end with the thread that started them.

    links: name -> address at which the vehicle receives MAVLink.
    """

    def __init__(self, address: str, *vehicles: PosingVehicle) -> None:
        self.address = address
        self._folder = folder = Path(tempfile.mkdtemp(prefix="arena-room-"))  # short, for the clock's socket
        keys = {
            v.name: {
                "id": v.number,
                "autopilot": "builtin",
                "start": {"position": v.position},
                "params": {**NO_RADIO, **v.params},
            }
            for v in vehicles
        }
        arena = {"address": address, "world": {"size": [14, 6, 3]}, "vehicles": keys}
        (folder / "arena.yaml").write_text(json.dumps(arena))
        slices = make_plan(load_arena(folder / "arena.yaml")).slices
        self.links: dict[str, tuple[str, int]] = {}
        for vehicle, own in zip(vehicles, slices["world.json"]["vehicles"], strict=True):
            self.links[vehicle.name] = tuple(own["links"]["router"]["local"])
            own["links"]["router"]["remote"] = list(vehicle.partner)
        self._slices = {name: self._write(name, slices[f"{name}.json"]) for name in ("world", "mocap")}
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self._start("world", "arena.sim")
        deadline = time.monotonic() + 90.0
        while not (folder / "clock.sock").exists():
            assert time.monotonic() < deadline and self.processes["world"].poll() is None, self.said("world")
            time.sleep(0.02)
        self._start("mocap", "arena.mocap.emulator")

    def inject(self, process: str, fault: dict[str, Any]) -> None:
        """Inject a fault into the world or the cameras (process "mocap")."""
        inject(self._folder / f"{process}.faults", fault)

    def truth(self) -> Truth:
        found = TruthReader(self._folder / "truth").newest()
        assert found is not None
        return found

    def said(self, name: str) -> str:
        return (self._folder / f"{name}.log").read_text(errors="replace")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process in reversed(self.processes.values()):
            process.kill()
            process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _start(self, name: str, module: str) -> None:
        with (self._folder / f"{name}.log").open("wb") as log:
            argv = [sys.executable, "-m", module, str(self._slices[name])]
            ends = {"stdout": log, "stderr": subprocess.STDOUT, "stdin": subprocess.DEVNULL}
            process = subprocess.Popen(
                argv,
                start_new_session=True,
                preexec_fn=_end_with_us,  # noqa: PLW1509  nothing else is done in it
                **ends,
            )
        self.processes[name] = process
        with contextlib.suppress(OSError):  # reality does not slow down when this computer is busy
            os.setpriority(os.PRIO_PROCESS, process.pid, -10)
            Path(f"/proc/{process.pid}/autogroup").write_text("-10")

    def _write(self, name: str, slice_: dict[str, Any]) -> Path:
        file = self._folder / f"{name}.json"
        file.write_text(
            json.dumps(slice_).replace("{rt}", str(self._folder)).replace("{run}", str(self._folder))
        )
        return file
