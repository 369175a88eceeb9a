"""File wire/<vehicle>.json in the run folder: last address and hardware uid of a real vehicle.

The link process writes it for land-all, which needs the address if the link process ends or hangs, and for its own restart.
"""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

from arena.transport import Source


class WireRecord:
    """File with the last address and the hardware uid of one vehicle.

    path: path of the file; "" if nothing is recorded.
    """

    def __init__(self, path: str) -> None:
        self._path = Path(path) if path else None
        self._last: dict[str, Any] = {}

    def read(self) -> tuple[str, Source | None]:
        """Return the vehicle's hardware uid, and the address or device from which it was last received.

        An earlier link process of the same run has written them, before it was restarted. Without a record, the uid is ""
        and the address is None.
        """
        if self._path is not None:
            with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
                found = json.loads(self._path.read_text())
                uid = str(found.get("uid", ""))
                if found["kind"] == "serial":
                    return uid, str(found["device"])
                host, port = found["vehicle"]
                return uid, (str(host), int(port))
        return "", None

    def is_new(self, address: dict[str, Any]) -> bool:
        """Return whether the autopilot's address or uid has changed since the last call.

        If so, the record must be written again.
        """
        before, self._last = self._last, address
        return self._path is not None and address != before

    def write(self, address: dict[str, Any]) -> None:
        """Write the vehicle's last address and its hardware uid to the file.

        Raises OSError if the file cannot be written.
        """
        if self._path is None:
            return
        half = self._path.with_name(self._path.name + ".new")
        self._path.parent.mkdir(parents=True, exist_ok=True)
        half.write_text(json.dumps(address))
        half.replace(self._path)
