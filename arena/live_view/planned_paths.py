"""Reader of the planned paths of all vehicles, from the files that the recorder of a running arena writes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NO_PATH: Array = np.zeros((0, 3))


class PlannedPaths:
    """Reader of the planned paths of all vehicles, which the recorder writes to one file per vehicle.

    folder: contains a file `<vehicle>.json` per vehicle. None: the arena records no planned paths.

    newest: one path per vehicle [m] [NED] (k, 3), without points if the vehicle has none. A new tuple after each change.
    """

    def __init__(self, folder: str | None, vehicles: Sequence[str]) -> None:
        self._files = [] if folder is None else [Path(folder) / f"{name}.json" for name in vehicles]
        self._seen = [0] * len(self._files)
        self.newest: tuple[Array, ...] = (NO_PATH,) * len(vehicles)

    def poll(self) -> None:
        """Read the path files that have changed since the last call, and update `newest`."""
        found = list(self.newest)
        changed = False
        for k, file in enumerate(self._files):
            with suppress(OSError, ValueError):
                stamp = file.stat().st_mtime_ns
                if stamp != self._seen[k]:
                    self._seen[k] = stamp
                    found[k] = np.array(json.loads(file.read_bytes()), float).reshape(-1, 3)
                    changed = True
        if changed:
            self.newest = tuple(found)
