"""The YAML key `measured` of a real vehicle: parameters that a person has measured, with date and method."""

import datetime
from typing import Annotated

from pydantic import AfterValidator, Field

from arena.schema.base import Strict


def _date(text: str) -> str:
    try:
        return datetime.date.fromisoformat(text).isoformat()
    except ValueError as error:
        raise ValueError("expected a date such as 2026-11-20") from error


class Measured(Strict):
    """A PX4 parameter that was measured on this vehicle."""

    value: float
    """Value of the parameter, in the parameter's unit."""
    date: Annotated[str, AfterValidator(_date)]
    """Day of the measurement, such as 2026-11-20."""
    how: Annotated[str, Field(min_length=3)]
    """How it was measured, such as "mean of 30 s hover, 4S 5000 mAh"."""
