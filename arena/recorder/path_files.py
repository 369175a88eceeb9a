"""Writes the newest planned path of each vehicle to a file in the runtime folder. Viewers read these files.

The files belong to a run that is in progress. The record contains the messages themselves.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from arena.background_writer import BackgroundWriter
from arena.mocap.client import CapturedFrame
from arena.recorder.channels import Datagram, Recorded
from arena.wire.planned_path import PathAssembler, may_contain_path
from arena.wire.truth_rows import TrueStates


class PathFiles:
    """Writer of one file with the newest planned path per vehicle.

    The methods are those of `RecordChannels`. A thread writes, so that no call blocks.

    vehicles: vehicles of the arena.  folder: `<vehicle>.json` is written here.
    """

    def __init__(self, vehicles: Sequence[Recorded], folder: Path) -> None:
        self._folder = folder
        self._paths = {v.name: PathAssembler(v.id) for v in vehicles}
        self._writer = BackgroundWriter("planned-paths", limit=len(self._paths) + 1)

    def on_datagrams(self, datagrams: list[Datagram]) -> None:
        for vehicle, up, data, _ in datagrams:
            if up and may_contain_path(data) and self._paths[vehicle].on_datagram(data):
                points = tuple(self._paths[vehicle].points)
                self._writer.submit(partial(self._write, vehicle, points), replaces=vehicle)

    def on_frame(self, frame: CapturedFrame, simulated: bool, time_s: float) -> None:
        return

    def on_truth(self, truth: TrueStates, time_s: float) -> None:
        return

    def on_event(self, line: bytes, fields: Mapping[str, Any], time_s: float) -> None:
        return

    def _write(self, vehicle: str, points: Sequence[tuple[float, float, float]]) -> None:
        with suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            part = self._folder / f".{vehicle}.part"
            part.write_text(json.dumps(points))
            part.replace(self._folder / f"{vehicle}.json")
