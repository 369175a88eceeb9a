"""Startup scripts and parameters of a simulated PX4. Pure, except that it reads templates/px4."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from arena.errors import InputError
from arena.params.facts.parameter_table import parameters, versions
from arena.schema import Arena, Vehicle
from arena.schema.library import data_folder
from arena.vehicle_models import VEHICLE_MODELS

SCRIPTS = ("px4-rc.mavlink", "px4-rc.mavlinksim")

# Only for simulated PX4: no compass, battery may discharge completely, log from arming to disarming
SIMULATED: dict[str, float] = {"SYS_HAS_MAG": 0, "SIM_BAT_MIN_PCT": 0.0, "SDLOG_MODE": 0}


_MOTOR_1 = 101  # output function of the first motor


def px4_scripts(given: dict[str, Any]) -> dict[str, str]:
    """Return the startup scripts of a simulated PX4: {file name in `etc/init.d-posix`: text}.

    given: values of the placeholders in the script templates, by name.
    """
    import jinja2

    loader = jinja2.FileSystemLoader(str(data_folder("templates") / "px4"))
    templates = jinja2.Environment(
        loader=loader, undefined=jinja2.StrictUndefined, keep_trailing_newline=True
    )
    return {name: templates.get_template(f"{name}.j2").render(given) for name in SCRIPTS}


def px4_params(v: Vehicle, values: Mapping[str, float]) -> dict[str, float | int]:
    """Return the parameters that a simulated PX4 sets at its start, in addition to its airframe's parameters.

    values: the vehicle's firmware parameters.
    """
    battery = v.profile.battery
    lasts = {"SIM_BAT_DRAIN": round(3.6 * battery.capacity_mah / battery.hover_a)}
    compass = (
        {} if v.forward or not v.gps else {"SYS_HAS_MAG": 1}
    )  # with GPS alone the heading comes from the compass
    found: dict[str, float] = {**SIMULATED, **lasts, **compass, **_airframe(v), **values}
    found.pop("MAV_SYS_ID", None)  # the startup script sets it, after PX4 has set its own
    # Integers without a decimal point, because `param set` refuses a decimal point for INT32
    return {
        name: int(value) if float(value).is_integer() else float(value)
        for name, value in sorted(found.items())
    }


def _airframe(v: Vehicle) -> dict[str, float]:
    """Return the parameters that differ from PX4's airframe file: the output of each motor, and MAV_TYPE.

    The airframe has outputs for four motors only. The rotor geometry is among the firmware parameters.
    """
    rotors = len(v.profile.rotors)
    outputs = {f"PWM_MAIN_FUNC{k + 1}": _MOTOR_1 + k for k in range(rotors)}
    return {"MAV_TYPE": VEHICLE_MODELS[v.profile.vehicle_class].mav_type(rotors), **outputs}


def xrce_environment(arena: Arena, v: Vehicle) -> dict[str, str]:
    """Return the environment variables that connect a PX4 SITL to the agent of `tools.microxrce`.

    Returns {} without an agent. PX4's startup script (v1.14 and newer) reads them: namespace of the topics,
    port of the agent, and domain. It sets UXRCE_DDS_KEY to the number of the PX4 instance, so every vehicle
    has a session of its own.
    """
    agent = next((tool.microxrce for tool in arena.tools.values() if tool.microxrce is not None), None)
    if agent is None:
        return {}
    return {
        "PX4_UXRCE_DDS_NS": v.name,
        "PX4_UXRCE_DDS_PORT": str(agent.port),
        "ROS_DOMAIN_ID": str(agent.domain),
    }


def reset_by_startup(params: Mapping[str, float | int], version: str) -> dict[str, float | int]:
    """Return the parameters that PX4's startup script resets, so that they must be set again.

    PX4's startup treats a value equal to the firmware's default as unset, and applies its own default for simulated
    vehicles (COM_LOW_BAT_ACT 0 became 3).
    version: version of the PX4 binary; an unknown version counts as the newest.
    """
    try:
        known = parameters(version)
    except InputError:
        known = parameters(versions()[-1])
    return {name: value for name, value in params.items() if name in known and value == known[name].default}


def hitl_params(v: Vehicle, values: Mapping[str, float]) -> dict[str, float | int]:
    """Return the parameters that a flight controller needs for hardware in the loop (HITL).

    Source: PX4 airframe 1001.
    """
    outputs = {f"HIL_ACT_FUNC{i + 1}": _MOTOR_1 + i for i in range(len(v.profile.rotors))}
    # A board has no SIM_* parameters, and its PWM outputs stay as they are: real motors may be connected.
    not_held = ("SIM_", "PWM_MAIN_")
    held = {name: value for name, value in px4_params(v, values).items() if not name.startswith(not_held)}
    return {**held, "MAV_SYS_ID": v.id, "SYS_HITL": 1, "CBRK_SUPPLY_CHK": 894281, **outputs}
