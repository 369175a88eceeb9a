"""Converts an `Arena` (the checked YAML) to a `Plan` (all processes to start, as data).

Pure. The package does not import the code of these processes.

`arena.plan.model` imports the standard library only, so that land-all can read plans quickly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from arena.plan.model import LinkPlan, Listen, Plan, ProcessSpec, Restart, VehiclePlan

if TYPE_CHECKING:
    from arena.plan.make import make_plan

__all__ = ["LinkPlan", "Listen", "Plan", "ProcessSpec", "Restart", "VehiclePlan", "make_plan"]


def __getattr__(name: str) -> Any:
    """Import `make_plan` at its first use, because the modules that it needs load slowly."""
    if name == "make_plan":
        from arena.plan.make import make_plan

        return make_plan
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
