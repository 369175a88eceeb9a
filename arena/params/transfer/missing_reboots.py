"""Record of the reboots that are missing after pushes, in the file missing_reboots.json.

Some parameters take effect only after a reboot of the autopilot. The next push finds these parameters with their wanted values,
so without this record it would not report the missing reboot.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from arena.errors import InputError
from arena.params.transfer.uid_check import NO_UID
from arena.whole_file import replace_file

FILE = "missing_reboots.json"
_FORMAT = "arena missing reboots 1"


@dataclass(frozen=True, kw_only=True)
class MissingReboot:
    """Reboot that one autopilot needs.

    vehicle: name of the vehicle.
    parameters: parameters that were written and take effect only after a reboot.
    written_at: time after which the autopilot must boot [s] (Unix time).
    """

    vehicle: str
    parameters: tuple[str, ...]
    written_at: float


class MissingReboots:
    """Missing reboots of autopilots, kept in the file `path`.

    The key of an autopilot is its hardware uid, or its address if it reports none (see `autopilot_key`).
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
            found = {
                str(key): MissingReboot(
                    vehicle=str(each["vehicle"]),
                    parameters=tuple(map(str, each["parameters"])),
                    written_at=float(each["written_at"]),
                )
                for key, each in raw["autopilots"].items()
            }
        except FileNotFoundError:
            found = {}
        except OSError as error:
            raise InputError(f"{path}: {error.strerror}") from error
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(
                f"{path} is not a record of missing reboots: {error}. Reboot all vehicles and delete the file"
            ) from error
        return cls(path, found)

    def add(self, key: str, vehicle: str, parameters: Iterable[str], now: float) -> None:
        """Record that parameters were written which need a reboot. Parameters in the record are kept. now: Unix time [s]."""
        earlier = self.autopilots[key].parameters if key in self.autopilots else ()
        names = tuple(dict.fromkeys((*earlier, *parameters)))
        self.autopilots[key] = MissingReboot(vehicle=vehicle, parameters=names, written_at=now)

    def remove(self, key: str) -> None:
        """Remove the missing reboot of an autopilot that has rebooted."""
        self.autopilots.pop(key, None)

    def remove_if_booted(self, key: str, booted_at: float | None) -> tuple[str, ...]:
        """Remove the missing reboot of an autopilot if it has booted since the values were written.

        booted_at: time of its last boot [s] (Unix time); None: unknown.
        Return the parameters that have taken effect with this boot.
        """
        missing = self.autopilots.get(key)
        if missing is None or booted_at is None or booted_at <= missing.written_at:
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


def autopilot_key(uid: str, address: str) -> str:
    """Return the key of an autopilot in the record: its hardware uid, or its address if it reports none."""
    return uid if uid not in ("", NO_UID) else address
