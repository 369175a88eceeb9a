"""The startup scripts and parameters of a simulated PX4, from templates/px4 and the vehicle. Reads the templates, else pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from arena.errors import InputError
from arena.params.facts.parameter_table import parameters, versions
from arena.schema import Vehicle
from arena.schema.library import data_folder

SCRIPTS = ("px4-rc.mavlink", "px4-rc.mavlinksim")

# What a simulated vehicle of an arena needs of PX4 beyond what every autopilot here gets: no satellites, no compass to trust,
# one battery that lasts as the profile's does in hover and does not stop half full, a log from arming to disarming.
SIMULATED: dict[str, float] = {"SYS_HAS_MAG": 0, "SIM_BAT_MIN_PCT": 0.0, "SDLOG_MODE": 0}


def px4_scripts(given: dict[str, Any]) -> dict[str, str]:
    """File name under `etc/init.d-posix` -> its text. given: the values that the templates name."""
    import jinja2

    loader = jinja2.FileSystemLoader(str(data_folder("templates") / "px4"))
    templates = jinja2.Environment(
        loader=loader, undefined=jinja2.StrictUndefined, keep_trailing_newline=True
    )
    return {name: templates.get_template(f"{name}.j2").render(given) for name in SCRIPTS}


def px4_params(v: Vehicle, values: Mapping[str, float]) -> dict[str, float | int]:
    """Every parameter that differs from PX4's airframe: the arena's, the profile's, the YAML's."""
    battery = v.profile.battery
    lasts = {"SIM_BAT_DRAIN": round(3.6 * battery.capacity_mah / battery.hover_a)}
    compass = (
        {} if v.forward or not v.gps else {"SYS_HAS_MAG": 1}
    )  # on satellites alone heading comes from it
    found: dict[str, float] = {**SIMULATED, **lasts, **compass, **values}
    found.pop("MAV_SYS_ID", None)  # the startup sets it after PX4 has set its own
    # Whole numbers without a point: `param set` refuses one in an integer, and minds none that is missing in a float.
    return {
        name: int(value) if float(value).is_integer() else float(value)
        for name, value in sorted(found.items())
    }


def forgotten(params: Mapping[str, float | int], version: str) -> dict[str, float | int]:
    """Those that are to be set once more, after PX4's own startup: a value that is the firmware's default counts as not set
    there, and the startup's default for a simulated vehicle takes its place (COM_LOW_BAT_ACT 0 became 3).
    """
    try:
        known = parameters(version)
    except InputError:  # one that no table has, or a binary that does not say
        known = parameters(versions()[-1])
    return {name: value for name, value in params.items() if name in known and value == known[name].default}


def hitl_params(v: Vehicle, values: Mapping[str, float]) -> dict[str, float | int]:
    """What a flight controller must hold to fly the simulated body. Source: PX4's airframe 1001 and its HIL outputs."""
    outputs = {f"HIL_ACT_FUNC{i + 1}": 101 + i for i in range(len(v.profile.rotors))}
    held = {
        name: value for name, value in px4_params(v, values).items() if not name.startswith("SIM_")
    }  # a board need not know those
    return {**held, "MAV_SYS_ID": v.id, "SYS_HITL": 1, "CBRK_SUPPLY_CHK": 894281, **outputs}
