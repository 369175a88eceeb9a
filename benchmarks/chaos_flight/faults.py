"""The random faults of one flight, drawn from a seed. Pure."""

from __future__ import annotations

import random
from dataclasses import dataclass

VEHICLES = ("uav1", "uav2")
FLIGHT_S = 10.0
"""Time from the take-off to the end of the flight [s]."""
_SERVING = ("router", "link.{v}", "forward.{v}", "copilot", "program.{v}")
_KINDS = {
    "kill": 4,
    "pause": 4,
    "restart": 2,
    "unplug": 3,
    "stranger": 2,
    "swap bodies": 1,
    "pilot": 4,
    "delete the run folder": 1,
    "land-all": 1,
}
DISK_FAULTS = {"full disk": 0.15, "hung disk": 0.1}
"""Kind -> share of the flights that have it. Drawn last, so that the other faults of a seed do not depend on them."""
ENDS = ("Ctrl-C", "SIGTERM", "SIGHUP", "arena down", "land-all", "two land-all", "supervisor killed")


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault. at: time since the take-off [s]. what: its kind. target: process or vehicle. for_s: duration [s], 0 for ever."""

    at: float
    what: str
    target: str = ""
    for_s: float = 0.0

    def __str__(self) -> str:
        lasts = f" for {self.for_s:.1f} s" if self.for_s else ""
        return f"{self.at:.1f} s {self.what} {self.target}".rstrip() + lasts


@dataclass(frozen=True, kw_only=True)
class Script:
    """Faults of one flight. late: vehicle that is switched on late, "" for none. end: how the flight is ended."""

    seed: int
    faults: tuple[Fault, ...]
    late: str
    end: str

    def __str__(self) -> str:
        late = f"{self.late} joins late; " if self.late else ""
        return f"{late}{'; '.join(map(str, self.faults))}; end: {self.end}"


def draw(seed: int) -> Script:
    """Return the faults of the flight with this seed."""
    rng = random.Random(seed)
    kinds = rng.choices(list(_KINDS), list(_KINDS.values()), k=rng.randint(1, 4))
    faults = [_fault(kind, rng) for kind in kinds]
    late = rng.choice(VEHICLES) if rng.random() < 0.15 else ""
    end = rng.choice(ENDS)
    faults += [_disk_fault(kind, rng) for kind, share in DISK_FAULTS.items() if rng.random() < share]
    return Script(seed=seed, faults=tuple(sorted(faults, key=lambda fault: fault.at)), late=late, end=end)


def _disk_fault(kind: str, rng: random.Random) -> Fault:
    """Return a full disk, which may stay full, or a disk that lets every write wait."""
    at = rng.uniform(0.0, FLIGHT_S)
    if kind == "full disk":
        return Fault(at=at, what=kind, for_s=0.0 if rng.random() < 0.4 else rng.uniform(1.0, 12.0))
    return Fault(at=at, what=kind, for_s=rng.uniform(1.0, 20.0))


def _fault(kind: str, rng: random.Random) -> Fault:
    at, vehicle = rng.uniform(0.0, FLIGHT_S), rng.choice(VEHICLES)
    process = rng.choice(_SERVING).format(v=vehicle)
    if kind in ("kill", "restart"):
        return Fault(at=at, what=kind, target=process)
    if kind == "pause":
        return Fault(at=at, what=kind, target=process, for_s=rng.uniform(0.2, 4.0))
    if kind in ("unplug", "stranger"):
        lasts = 0.0 if rng.random() < 0.2 else rng.uniform(0.5, 8.0)
        return Fault(at=at, what=kind, target=vehicle, for_s=lasts)
    if kind == "swap bodies":
        return Fault(at=at, what=kind, for_s=rng.uniform(0.5, 3.0))
    if kind == "pilot":
        return Fault(at=at, what=kind, target=vehicle, for_s=rng.uniform(3.0, 12.0))
    return Fault(at=at, what=kind)
