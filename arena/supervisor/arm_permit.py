"""Arm permits, which allow real vehicles to arm: their conditions, and the requests to link processes. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from arena.plan.model import Plan
from arena.supervisor.process_state import ProcessStatus, State

CONFIRMATION_S = 30.0  # the confirmation of `arena up` counts for vehicles that are connected by then


def permit_request(vehicle: str, by: str) -> dict[str, str]:
    """Return the request that makes a real vehicle's link process permit arming.

    by: person who gives the permit.
    """
    return {"do": "permit", "vehicle": vehicle, "by": by}


def real_vehicles(plan: Plan, statuses: Mapping[str, ProcessStatus]) -> dict[str, bool]:
    """Return the real vehicles: name -> whether the vehicle's link process is ready.

    It is ready only after the vehicle was connected.
    """
    names = [v.name for v in plan.vehicles if not v.simulated]
    return {name: statuses[f"link.{name}"].state is State.READY for name in names}


def check_permit(real: Mapping[str, bool], vehicles: Sequence[str]) -> None:
    """Raise ValueError if one of the vehicles cannot get an arm permit.

    real: result of `real_vehicles`.
    """
    if not real:
        raise ValueError("this arena has no real vehicle, and simulated vehicles need no arm permit")
    if not vehicles:
        raise ValueError(f"got no vehicle, expected at least one of {', '.join(real)}")
    for vehicle in vehicles:
        check_vehicle(real, vehicle)


def check_vehicle(real: Mapping[str, bool], vehicle: str) -> None:
    """Raise ValueError if a vehicle is not real or its link process is not ready."""
    if vehicle not in real:
        known = ", ".join(real) or "none, because all vehicles of this arena are simulated"
        raise ValueError(f"got vehicle {vehicle!r}, expected a real vehicle: {known}")
    if not real[vehicle]:
        raise ValueError(f"{vehicle}: link.{vehicle} is not ready. Is the vehicle switched on?")


class Confirmation:
    """Consent of a person at the start of `arena up`: the connected real vehicles may arm.

    The confirmation is used once: when all processes are ready, at the latest CONFIRMATION_S after the start. It holds for the
    real vehicles that are connected at that time. So a vehicle whose battery is connected later does not take off.

    by: who has confirmed; "" if nobody has.  began: start of the run, monotonic [s].
    """

    def __init__(self, by: str, began: float) -> None:
        self.by, self._began, self._open = by, began, bool(by)

    def is_due(self, now: float, all_ready: bool) -> bool:
        """Return whether the person's consent must now be converted to arm permits. True at most once.

        now: monotonic [s].  all_ready: whether all processes of the arena are ready.
        """
        due = self._open and (all_ready or now - self._began >= CONFIRMATION_S)
        self._open = self._open and not due
        return due
