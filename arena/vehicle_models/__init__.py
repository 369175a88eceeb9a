"""Vehicle classes, such as multirotors: the properties and equations of each class in one place.

The world, the plan and the built-in autopilot use them. The table `VEHICLE_MODELS` lists the classes by the
profile's `vehicle_class`. A new class needs a module here that implements `VehicleModel`, and a row in this
table. No sockets, no clocks, no simulator here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from arena.errors import InputError
from arena.vehicle_models.model import CrashLimits, Dynamics, VehicleModel
from arena.vehicle_models.multirotor import Multirotor

__all__ = [
    "DEFAULT_CLASS",
    "VEHICLE_MODELS",
    "CrashLimits",
    "Dynamics",
    "VehicleModel",
    "vehicle_model",
]

DEFAULT_CLASS = "multirotor"

VEHICLE_MODELS: dict[str, VehicleModel] = {"multirotor": Multirotor()}


def vehicle_model(profile: Mapping[str, Any]) -> VehicleModel:
    """Return the model of a profile's `vehicle_class`. Raises InputError for an unknown class."""
    name = str(profile.get("vehicle_class", DEFAULT_CLASS))
    if name not in VEHICLE_MODELS:
        raise InputError(f"vehicle_class: got {name!r}, expected one of {', '.join(sorted(VEHICLE_MODELS))}")
    return VEHICLE_MODELS[name]
