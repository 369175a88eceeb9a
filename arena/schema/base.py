"""Base class and common types of the pydantic models of all YAML sections."""

from __future__ import annotations

import ipaddress
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field


class Strict(BaseModel):
    """Strict base class of the pydantic models of all YAML sections.

    The models are frozen. They refuse unknown keys, NaN and infinity.

    pydantic builds a validator at the first validation, so that only models of documents get one (`defer_build`).
    Default values that are models themselves are therefore made with `model_construct`, and `as_dict` replaces `model_dump`:
    neither needs a validator.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        validate_default=False,
        defer_build=True,
    )

    def as_dict(self, *, json: bool = False, without_none: bool = False) -> dict[str, Any]:
        """Return the values of a model as a dictionary. Nested models become dictionaries, too.

        json: tuples become lists. without_none: keys whose value is None are omitted.
        """
        found = {key: getattr(self, key) for key in type(self).model_fields}
        return {
            key: _plain(value, json=json, without_none=without_none)
            for key, value in found.items()
            if value is not None or not without_none
        }


def _plain(value: Any, *, json: bool, without_none: bool) -> Any:
    if isinstance(value, Strict):
        return value.as_dict(json=json, without_none=without_none)
    if isinstance(value, dict):
        kept = {key: each for key, each in value.items() if each is not None or not without_none}
        return {key: _plain(each, json=json, without_none=without_none) for key, each in kept.items()}
    if isinstance(value, (list, tuple)):
        items = [_plain(each, json=json, without_none=without_none) for each in value]
        return items if json else tuple(items)
    return value


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
