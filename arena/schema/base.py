"""What every model of the YAML is: frozen, strict, no unknown keys, no NaN and no infinity."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field


class Strict(BaseModel):
    """Base of all models."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,
        validate_default=False,
    )


Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Vector = tuple[float, float, float]
Span = tuple[float, float]
PositiveVector = tuple[Positive, Positive, Positive]
Port = Annotated[int, Field(ge=1024, le=65535)]
