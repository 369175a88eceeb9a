"""Arena -> Plan: processes as data. Pure; names rooms by their command line and imports none of them.

`arena.plan.model` alone costs nothing to import: land-all reads plans with it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from arena.plan.model import LinkPlan, Listen, Plan, ProcessSpec, Restart, VehiclePlan

if TYPE_CHECKING:
    from arena.plan.make import make_plan

__all__ = ["LinkPlan", "Listen", "Plan", "ProcessSpec", "Restart", "VehiclePlan", "make_plan"]


def __getattr__(name: str) -> Any:
    """make_plan brings the schema and pydantic along, so it is imported when it is asked for."""
    if name == "make_plan":
        from arena.plan.make import make_plan

        return make_plan
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
