"""Sends arm permits and axes checks for real vehicles to their hardware link processes."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from arena.plan.model import Plan
from arena.supervisor.arm_permit import (
    Confirmation,
    check_permit,
    check_vehicle,
    permit_request,
    real_vehicles,
)
from arena.supervisor.axes_check import check_request
from arena.supervisor.process_set import ProcessSet
from arena.supervisor.release_task import CONFIRM_S


class Permits:
    """Sender of arm permits and axes checks (`arena preflight`) for the real vehicles of a run.

    confirmation: what a person has confirmed at `arena up`. show: prints a line for the user.
    """

    def __init__(
        self, plan: Plan, processes: ProcessSet, confirmation: Confirmation, show: Callable[[str], None]
    ) -> None:
        self._plan, self._processes = plan, processes
        self._confirmation, self._show = confirmation, show

    def use_confirmation(self, now: float, all_ready: bool) -> None:
        """Give an arm permit to the connected real vehicles, if a person has given consent at `arena up`.

        The user reads which vehicles are not connected, and so get no permit. now: monotonic [s].
        all_ready: whether all processes of the arena are ready.
        """
        if not self._confirmation.is_due(now, all_ready):
            return
        real = self._real()
        if connected := [name for name, ready in real.items() if ready]:
            try:
                self.grant(connected, self._confirmation.by)
            except ValueError as error:
                self._show(str(error))
        for name in (name for name, ready in real.items() if not ready):
            self._show(f"{name}: not connected, so it has no arm permit; later run `arena arm-permit {name}`")

    def grant(self, vehicles: Sequence[str], by: str) -> None:
        """Permit real vehicles to arm. Raises ValueError if the link process of a vehicle did not receive the permit.

        The error names the vehicles.

        If one of the vehicles must not get a permit, none gets it. by: who permits it.
        """
        check_permit(self._real(), vehicles)
        failed = [vehicle for vehicle in vehicles if not self._send(vehicle, by)]
        if failed:
            links = ", ".join(f"link.{vehicle}" for vehicle in failed)
            raise ValueError(
                f"{', '.join(failed)}: no arm permit: {links} has ended or hangs, so it did not receive the permit. Wait until "
                f"`arena ps` shows it as READY, then repeat `arena arm-permit {' '.join(failed)}`"
            )

    def _send(self, vehicle: str, by: str) -> bool:
        """Send an arm permit to the link process of a real vehicle. Return whether the process received it."""
        packet = {**permit_request(vehicle, by), "expires": time.monotonic() + CONFIRM_S}
        return not self._processes.request(packet, to=[f"link.{vehicle}"])

    def check_axes(self, vehicle: str, by: str, *, stop: bool) -> None:
        """Start or stop the axes check (`arena preflight`) of a vehicle. Raises ValueError if it is not possible.

        by: who checks it.
        """
        check_vehicle(self._real(), vehicle)
        self._processes.request(check_request(vehicle, by, stop=stop), to=[f"link.{vehicle}"])

    def _real(self) -> dict[str, bool]:
        return real_vehicles(self._plan, self._processes.statuses)
