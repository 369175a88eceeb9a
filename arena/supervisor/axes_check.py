"""Requests to the link processes of real vehicles, for the identity and axes check (`arena preflight`). Pure.

In the identity and axes check, a person moves the vehicle by hand. The link process compares the motion that the IMU measures with
the poses of motion capture. The check shows whether the vehicle gets the poses of its own rigid body, with the right axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from arena.plan.model import Plan


def check_request(vehicle: str, by: str, *, stop: bool) -> dict[str, str]:
    """Return the request to a vehicle's link process: start or stop the identity and axes check (`arena preflight`).

    by: person who asks for the check.
    """
    return {"do": "stop_axes_check" if stop else "axes_check", "vehicle": vehicle, "by": by}


def body_requests(plan: Plan, stats: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, dict[str, str]]]:
    """Return messages that report to each link process the rigid body definition of its real vehicle.

    They are pairs (link process, message). A definition is the set of markers as the motion-capture software has stored it.

    The link process refuses to arm the vehicle if the definition has changed since the last passed check. The pose forwarder of the
    vehicle reports the definition; a vehicle without such a report is left out.

    stats: process -> its measurements.
    """
    found = []
    for v in plan.vehicles:
        definition = stats.get(f"forward.{v.name}", {}).get("body_definition")
        if not v.simulated and definition is not None:
            request = {"do": "body", "vehicle": v.name, "definition": str(definition)}
            found.append((f"link.{v.name}", request))
    return found
