"""Record of the reboots that are missing after pushes, in the file missing_reboots.json.

Some parameters take effect only after a reboot of the autopilot. The next push finds these parameters with their wanted values,
so without this record it would not report the missing reboot.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from arena.clock_reading import boot_id
from arena.errors import InputError
from arena.whole_file import replace_file
from arena.wire.mavlink_minimal import NO_UID

FILE = "missing_reboots.json"
_FORMAT = "arena missing reboots 1"
_LATEST_S = 1e11  # largest time in the file [s]; `datetime` has no year for much larger ones
_UPTIME_ERROR_S = 1.0  # delay of the messages from which the time since the vehicle's boot is known


@dataclass(frozen=True, kw_only=True)
class ClockTime:
    """Time of this computer.

    unix_s: Unix time [s]. It jumps when the clock is set.
    boot_id: id of the computer's boot; "" if unknown.
    since_boot_s: time since the computer's boot [s]. It does not jump.
    """

    unix_s: float
    boot_id: str = ""
    since_boot_s: float = 0.0

    @classmethod
    def now(cls) -> ClockTime:
        """Return the present time."""
        since_boot_s = time.clock_gettime(time.CLOCK_BOOTTIME)
        return cls(unix_s=time.time(), boot_id=boot_id(), since_boot_s=since_boot_s)


@dataclass(frozen=True, kw_only=True)
class MissingReboot:
    """Reboot that one autopilot needs.

    vehicle: name of the vehicle.
    parameters: parameters that were written and take effect only after a reboot.
    written_at: time after which the autopilot must boot [s] (Unix time).
    address: address of the vehicle, as text.
    uptime_s: time since the autopilot's boot at `written_at` [s]; None if unknown.
    boot_id: id of the computer's boot at `written_at`; "" if unknown.
    since_boot_s: time since the computer's boot at `written_at` [s].
    """

    vehicle: str
    parameters: tuple[str, ...]
    written_at: float
    address: str = ""
    uptime_s: float | None = None
    boot_id: str = ""
    since_boot_s: float = 0.0

    def has_booted(self, uptime_s: float | None, now: ClockTime) -> bool:
        """Return whether the autopilot has booted since the values were written.

        uptime_s: time since the autopilot's boot [s]; None if unknown.
        """
        if uptime_s is None:
            return False
        if self.uptime_s is not None and uptime_s < self.uptime_s - _UPTIME_ERROR_S:
            return True
        same_boot = self.boot_id != "" and self.boot_id == now.boot_id
        elapsed_s = now.since_boot_s - self.since_boot_s if same_boot else now.unix_s - self.written_at
        return uptime_s < elapsed_s


class MissingReboots:
    """Missing reboots of autopilots, kept in the file `path`.

    The key of an autopilot is its hardware uid, or its address if it reports none (see `key_of`).
    """

    def __init__(self, path: Path, autopilots: dict[str, MissingReboot]) -> None:
        self.path, self.autopilots = path, autopilots

    @classmethod
    def read(cls, folder: Path) -> MissingReboots:
        """Read the missing reboots of a folder. Without the file, no reboot is missing.

        Raises InputError if the file is not a record of missing reboots.
        """
        path = folder / FILE
        try:
            raw = json.loads(path.read_text())
            if raw["format"] != _FORMAT:
                raise ValueError(f"the key `format` is {raw['format']!r}, expected {_FORMAT!r}")
            found = {str(key): _parse(each) for key, each in raw["autopilots"].items()}
        except FileNotFoundError:
            found = {}
        except OSError as error:
            raise InputError(f"{path}: {error.strerror}") from error
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(
                f"{path} is not a record of missing reboots: {error}. Reboot all vehicles and delete the file"
            ) from error
        return cls(path, found)

    def copy(self) -> MissingReboots:
        """Return a copy. Changes of the copy do not change this object."""
        return MissingReboots(self.path, dict(self.autopilots))

    def key_of(self, uid: str, address: str) -> str:
        """Return the key of an autopilot: its hardware uid, or its address if it reports none.

        An autopilot whose uid is unknown ("") gets the key of the latest entry with its address, because the reply with the uid
        may be lost. For the same reason an entry without a uid is moved to the uid that is reported now.
        """
        if uid not in ("", NO_UID):
            if address in self.autopilots:
                earlier, known = self.autopilots.pop(address), self.autopilots.get(uid)
                self.autopilots[uid] = earlier if known is None else _merged(known, earlier)
            return uid
        same = [key for key, each in self.autopilots.items() if each.address == address and uid == ""]
        return max(same, key=lambda key: self.autopilots[key].written_at, default=address)

    def of(self, uid: str, address: str) -> MissingReboot | None:
        """Return the reboot that an autopilot still needs; None if it needs none. This object is not changed.

        uid: its hardware uid; "" if unknown.  address: its address, as text.
        """
        found = self.copy()
        return found.autopilots.get(found.key_of(uid, address))

    def add(
        self,
        key: str,
        vehicle: str,
        parameters: Iterable[str],
        now: ClockTime,
        *,
        address: str = "",
        uptime_s: float | None = None,
    ) -> None:
        """Record that parameters were written which need a reboot. Parameters in the record are kept.

        now: time after which the autopilot must boot.
        address: address of the vehicle, as text.
        uptime_s: time since the autopilot's boot [s]; None if unknown.
        """
        new = MissingReboot(
            vehicle=vehicle,
            parameters=tuple(parameters),
            written_at=now.unix_s,
            address=address,
            uptime_s=uptime_s,
            boot_id=now.boot_id,
            since_boot_s=now.since_boot_s,
        )
        earlier = self.autopilots.get(key)
        self.autopilots[key] = new if earlier is None else _with_parameters(new, earlier)

    def remove(self, key: str) -> None:
        """Remove the missing reboot of an autopilot that has rebooted."""
        self.autopilots.pop(key, None)

    def remove_if_booted(self, key: str, uptime_s: float | None, now: ClockTime) -> tuple[str, ...]:
        """Remove the missing reboot of an autopilot if it has booted since the values were written.

        uptime_s: time since its last boot [s]; None: unknown.
        Return the parameters that have taken effect with this boot.
        """
        missing = self.autopilots.get(key)
        if missing is None or not missing.has_booted(uptime_s, now):
            return ()
        self.remove(key)
        return missing.parameters

    def save(self) -> None:
        """Write the file, or delete it if no reboot is missing. Raises OSError if the file cannot be written."""
        if not self.autopilots:
            self.path.unlink(missing_ok=True)
            return
        autopilots = {key: asdict(each) for key, each in self.autopilots.items()}
        replace_file(self.path, json.dumps({"format": _FORMAT, "autopilots": autopilots}, indent=1) + "\n")


def _with_parameters(new: MissingReboot, earlier: MissingReboot) -> MissingReboot:
    """Return the missing reboot `new` with the parameters of both."""
    return replace(new, parameters=tuple(dict.fromkeys((*earlier.parameters, *new.parameters))))


def _merged(a: MissingReboot, b: MissingReboot) -> MissingReboot:
    """Return one missing reboot for two of the same autopilot: all parameters, and the later time."""
    earlier, later = sorted((a, b), key=lambda each: each.written_at)
    return _with_parameters(later, earlier)


def _parse(raw: Any) -> MissingReboot:
    uptime_s = raw.get("uptime_s")
    return MissingReboot(
        vehicle=str(raw["vehicle"]),
        parameters=tuple(map(str, raw["parameters"])),
        written_at=_seconds("written_at", raw["written_at"]),
        address=str(raw.get("address", "")),
        uptime_s=None if uptime_s is None else _seconds("uptime_s", uptime_s),
        boot_id=str(raw.get("boot_id", "")),
        since_boot_s=_seconds("since_boot_s", raw.get("since_boot_s", 0.0)),
    )


def _seconds(name: str, value: Any) -> float:
    """Check a time from the file, and return it [s]. Raises ValueError for an impossible time."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not 0 <= value <= _LATEST_S:  # also refuses NaN and infinity
        raise ValueError(f"{name} is {value!r}, expected a time from 0 to {_LATEST_S:.0f} s")
    return float(value)
