"""Record of the last axes check that a vehicle has passed: the file preflight/<vehicle>.json.

The folder `preflight` is beside the arena's YAML.

It is valid until the rigid body is defined again, the autopilot is another one, or the autopilot or this computer has
been started again.
"""

from __future__ import annotations

import contextlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

BOOT_TOLERANCE_S = 5.0  # quartz clocks drift by up to 1 s in 3 h


@dataclass(frozen=True, kw_only=True)
class BootTime:
    """Time at which an autopilot booted.

    computer: boot id of this computer (`arena.clock_reading.boot_id`)
    at_s: time of the autopilot's start, counted from the boot of this computer [s]
    """

    computer: str
    at_s: float

    def same_as(self, other: BootTime) -> bool:
        """Return whether two recorded boot times belong to the same boot of the autopilot (no reboot between them).

        They differ by 5 s at most, on the same computer without a reboot of it.
        """
        return self.computer == other.computer != "" and abs(self.at_s - other.at_s) <= BOOT_TOLERANCE_S


@dataclass(frozen=True, kw_only=True)
class AxesRecord:
    """Record of a passed axes check.

    uid: hardware uid of the autopilot
    body: name of the rigid body
    definition: text that changes when the rigid body is defined again, such as a hash of its markers
    boot: time at which the autopilot was started
    by: person who made the check
    when: date and time of the check, ISO 8601, UTC
    turned_deg: angle between the captured body axes and the axes of the inertial sensors [deg]
    correlation: of the sizes of captured and measured rotation rates, -1 to 1 [-]
    delay_ms: delay of the poses that are sent to the autopilot [ms]; None if it was not measured
    """

    vehicle: str
    uid: str
    body: str
    definition: str
    boot: BootTime
    by: str
    when: str
    turned_deg: float
    correlation: float
    delay_ms: float | None

    def difference(self, uid: str, body: str, definition: str, boot: BootTime) -> str:
        """Return what has changed since the axes check, such as `body changed`; "" if nothing has changed."""
        if (self.body, self.definition) != (body, definition):
            return "body changed"
        if self.uid != uid:
            return "other autopilot"
        return "" if self.boot.same_as(boot) else "has rebooted"


class RecordFile:
    """File with the record of one vehicle's last passed axes check.

    path: path of the file; "" if no record is kept.
    """

    def __init__(self, path: str) -> None:
        self._path = Path(path) if path else None

    def read(self) -> AxesRecord | None:
        """Return the record of the last axes check; None if the file is missing or cannot be read."""
        if self._path is not None:
            with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
                return _record(json.loads(self._path.read_text()))
        return None

    def write(self, record: AxesRecord | None) -> None:
        """Write the record of a passed axes check to its file, or delete the file if `record` is None.

        Raises OSError if the file cannot be written or deleted.
        """
        if self._path is None:
            return
        if record is None:
            self._path.unlink(missing_ok=True)
            return
        half = self._path.with_name(self._path.name + ".new")
        self._path.parent.mkdir(parents=True, exist_ok=True)
        half.write_text(json.dumps(asdict(record), indent=1) + "\n")
        half.replace(self._path)


def _record(raw: dict[str, Any]) -> AxesRecord:
    boot = BootTime(computer=str(raw["boot"]["computer"]), at_s=float(raw["boot"]["at_s"]))
    texts = {key: str(raw[key]) for key in ("vehicle", "uid", "body", "definition", "by", "when")}
    delay = raw["delay_ms"]
    return AxesRecord(
        **texts,
        boot=boot,
        turned_deg=float(raw["turned_deg"]),
        correlation=float(raw["correlation"]),
        delay_ms=None if delay is None else float(delay),
    )
