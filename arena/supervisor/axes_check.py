"""Identity and axes checks of real vehicles (`arena preflight`): requests to the vehicles' link processes. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from arena.plan.model import Plan


def check_request(vehicle: str, by: str, *, stop: bool) -> dict[str, str]:
    """Return the request with which the link process of a vehicle starts or stops an axes check. by: person who asks for the check."""
    return {"do": "stop_axes_check" if stop else "axes_check", "vehicle": vehicle, "by": by}


def body_requests(plan: Plan, stats: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, dict[str, str]]]:
    """Return (link process, request) for each real vehicle: the definition of its rigid body, which its pose forwarder has reported.

    stats: process -> its measurements
    """
    found = []
    for v in plan.vehicles:
        definition = stats.get(f"forward.{v.name}", {}).get("body_definition")
        if not v.simulated and definition is not None:
            request = {"do": "body", "vehicle": v.name, "definition": str(definition)}
            found.append((f"link.{v.name}", request))
    return found
