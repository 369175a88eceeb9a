"""A stand-in for real vehicles and a vendor's motion capture: a simulated world on another loopback address.

Its MAVLink on UDP and its NatNet stream are what a real vehicle and a real server send.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from arena.plan import make_plan
from arena.schema import load_arena
from arena.wire.truth_page import Truth, TruthReader


class PosingRoom:
    """A world with one posing vehicle.

    vehicle: name.
    number: system id.
    position: start position [m] [NED].
    partner: address that its MAVLink is sent to.
    """

    def __init__(
        self,
        address: str,
        partner: tuple[str, int],
        *,
        vehicle: str,
        number: int,
        position: list[float],
        params: dict[str, float] | None = None,
    ) -> None:
        self.address = address
        self._folder = folder = Path(tempfile.mkdtemp(prefix="arena-room-"))  # short, for the clock's socket
        keys = {"id": number, "autopilot": "builtin", "start": {"position": position}, "params": params or {}}
        arena = {"address": address, "world": {"size": [14, 6, 3]}, "vehicles": {vehicle: keys}}
        (folder / "arena.yaml").write_text(json.dumps(arena))
        slices = make_plan(load_arena(folder / "arena.yaml")).slices
        slices["world.json"]["vehicles"][0]["links"]["router"]["remote"] = list(partner)
        self._slices = {name: self._write(name, slices[f"{name}.json"]) for name in ("world", "mocap")}
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self._start("world", "arena.sim")
        deadline = time.monotonic() + 20.0
        while not (folder / "clock.sock").exists():
            assert time.monotonic() < deadline and self.processes["world"].poll() is None, self.said("world")
            time.sleep(0.02)
        self._start("mocap", "arena.mocap.emulator")

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
            process = subprocess.Popen(argv, start_new_session=True, **ends)
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
