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
    faults = sorted((_fault(kind, rng) for kind in kinds), key=lambda fault: fault.at)
    late = rng.choice(VEHICLES) if rng.random() < 0.15 else ""
    return Script(seed=seed, faults=tuple(faults), late=late, end=rng.choice(ENDS))


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
