"""YAML type of a hardware uid, the serial number of a flight controller."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import BeforeValidator


def _uid(value: Any) -> str:
    """Check the hardware uid of an autopilot. It must be a text.

    A number is refused, because YAML changes the digits of unquoted numbers.
    """
    text = value.lower().removeprefix("0x") if isinstance(value, str) else ""
    if text == "none" or (re.fullmatch(r"[0-9a-f]{16}|[0-9a-f]{36}", text) and text.strip("0")):
        return text
    raise ValueError(
        "expected 16 or 36 hexadecimal digits in quotes, or the word none if the autopilot reports no uid"
    )


HardwareUid = Annotated[str, BeforeValidator(_uid)]
