"""Conversion of an Arena to a Plan: the list of processes as data. Pure. Imports no package that runs as a process.

`arena.plan.model` imports the standard library only, so that land-all can read plans quickly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from arena.plan.model import LinkPlan, Listen, Plan, ProcessSpec, Restart, VehiclePlan

if TYPE_CHECKING:
    from arena.plan.make import make_plan

__all__ = ["LinkPlan", "Listen", "Plan", "ProcessSpec", "Restart", "VehiclePlan", "make_plan"]


def __getattr__(name: str) -> Any:
    """Import `make_plan` at its first use, because it imports the schema and pydantic."""
    if name == "make_plan":
        from arena.plan.make import make_plan

        return make_plan
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
