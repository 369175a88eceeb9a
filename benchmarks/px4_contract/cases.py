"""Table of the cases by name, in the order in which they are run and shown."""

from __future__ import annotations

# Each of these modules registers its cases when it is imported.
from px4_contract import (  # noqa: F401
    arming,
    commands,
    events,
    failing,
    flying,
    ground_link,
    ground_stations,
    link,
    offboard,
    params,
    sticks,
)
from px4_contract.registry import CASES, Case


def all_cases() -> dict[str, Case]:
    """Return all cases by name."""
    return CASES
