"""Base class and common types of the pydantic models of all YAML sections."""

from __future__ import annotations

import ipaddress
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field


class Strict(BaseModel):
    """Base class of the pydantic models of all YAML sections: frozen and strict. Refuses unknown keys, NaN and infinity."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        validate_default=False,
    )


Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Vector = tuple[float, float, float]
Span = tuple[float, float]
PositiveVector = tuple[Positive, Positive, Positive]
Port = Annotated[int, Field(ge=1024, le=65535)]


def _ipv4(text: str) -> str:
    try:
        return str(ipaddress.IPv4Address(text))
    except ValueError as error:
        raise ValueError("expected a numeric IPv4 address such as 127.0.0.1") from error


Address = Annotated[str, AfterValidator(_ipv4)]
