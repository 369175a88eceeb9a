"""Creates the parameters and `Vehicle` objects of the built-in autopilots from the settings of the simulated world."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.param_table import Params
from arena.autopilot.vehicle import Vehicle
from arena.kernels.offboard_setpoints import OffboardSetpoints
from arena.vehicle_models import vehicle_model


def load_params(vehicles: list[Any]) -> tuple[Params, list[str]]:
    """Return the parameters of all vehicles, and one message for each parameter value that is refused.

    vehicles: the list `vehicles` of the settings
    """
    params, problems = Params(len(vehicles)), []
    for i, vehicle in enumerate(vehicles):
        values = {
            **vehicle["profile"].get("params", {}),
            **vehicle.get("params", {}),
            "MAV_SYS_ID": vehicle["id"],
        }
        problems += [f"{vehicle['name']}: {problem}" for problem in params.load(i, values)]
    return params, problems


def make_vehicles(
    settings: Mapping[str, Any], params: Params, est: Estimator, offboard: OffboardSetpoints
) -> list[Vehicle]:
    """Create a `Vehicle` for each entry of the list `vehicles` in the settings, in the same order."""
    return [
        Vehicle(
            i,
            x["name"],
            x["id"],
            params,
            est,
            offboard,
            mav_type=vehicle_model(x["profile"]).mav_type(len(x["profile"]["rotors"])),
            rotors=len(x["profile"]["rotors"]),
            heading=math.radians(settings.get("heading_deg", 0.0)),
        )
        for i, x in enumerate(settings["vehicles"])
    ]
