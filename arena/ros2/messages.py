"""Definitions of the ROS 2 messages that the bridge uses. Messages are dictionaries with all fields. Pure.

`messages.csv` has one row per field. The fields of `px4_msgs` are those of PX4 v1.16. A message is a dict: field -> value.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

Message = Mapping[str, Any]


@cache
def fields() -> dict[str, dict[str, str]]:
    """Return the definitions of the ROS 2 messages: message name -> field name -> field type.

    Example: `geometry_msgs/Pose` -> `position` -> `geometry_msgs/Point`.
    """
    found: dict[str, dict[str, str]] = {}
    with resources.files(__package__).joinpath("messages.csv").open() as file:
        for row in csv.DictReader(file):
            found.setdefault(row["message"], {})[row["field"]] = row["type"]
    return found


def message(name: str, **given: Any) -> dict[str, Any]:
    """Return a ROS 2 message with all its fields. Missing fields get a default.

    The default is NaN for floating point numbers, otherwise 0, false or empty.

    Raises KeyError if the message has no such field.
    """
    known = fields()[name]
    if unknown := set(given) - set(known):
        raise KeyError(f"the ROS 2 message {name} has no field {', '.join(sorted(unknown))}")
    return {
        field: given.get(field, _empty(kind)) if field in given else _empty(kind)
        for field, kind in known.items()
    }


def _empty(kind: str) -> Any:
    base, _, size = kind.rstrip("]").partition("[")
    if kind.endswith("]"):
        return [_empty(base)] * int(size or 0)
    if "/" in base:
        return message(base)
    if base.startswith("float"):
        return math.nan
    return {"bool": False, "string": ""}.get(base, 0)


def dds_type(name: str) -> str:
    """Return the DDS name of a ROS 2 type, such as `geometry_msgs::msg::dds_::Pose_`."""
    package, _, kind = name.partition("/")
    return f"{package}::msg::dds_::{kind}_"


def dds_topic(name: str) -> str:
    """Return the DDS name of a ROS 2 topic, such as `rt/uav1/pose` for `/uav1/pose`."""
    return f"rt/{name.lstrip('/')}"
