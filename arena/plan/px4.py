"""The startup scripts and parameters of a simulated PX4, from templates/px4 and the vehicle. Reads the templates, else pure."""

from __future__ import annotations

from typing import Any

from arena.schema import Vehicle
from arena.schema.library import data_folder

SCRIPTS = ("px4-rc.mavlink", "px4-rc.mavlinksim")

# What a simulated vehicle of an arena needs of PX4 beyond what every autopilot here gets: no satellites, no compass to trust,
# one battery that does not stop half full, a log from arming to disarming.
SIMULATED: dict[str, float] = {"SYS_HAS_MAG": 0, "SIM_BAT_MIN_PCT": 0.0, "SDLOG_MODE": 0}
# Integer parameters by their PX4 type: `param set` refuses a point in them.
_INTEGERS = frozenset({
    "CA_ROTOR_COUNT", "COM_OBL_RC_ACT", "COM_RC_IN_MODE", "COM_RCL_EXCEPT", "EKF2_EV_CTRL", "EKF2_GPS_CTRL", "EKF2_HGT_REF",
    "EKF2_MAG_TYPE", "EKF2_NOAID_TOUT", "MAV_SYS_ID", "SDLOG_MODE", "SYS_HAS_GPS", "SYS_HAS_MAG",
})  # fmt: skip


def px4_scripts(given: dict[str, Any]) -> dict[str, str]:
    """File name under `etc/init.d-posix` -> its text. given: the values that the templates name."""
    import jinja2

    loader = jinja2.FileSystemLoader(str(data_folder("templates") / "px4"))
    templates = jinja2.Environment(loader=loader, undefined=jinja2.StrictUndefined, keep_trailing_newline=True)
    return {name: templates.get_template(f"{name}.j2").render(given) for name in SCRIPTS}


def px4_params(v: Vehicle) -> dict[str, float | int]:
    """Every parameter that differs from PX4's airframe: the arena's, the profile's with its geometry, the YAML's."""
    found: dict[str, float] = {**SIMULATED, **_geometry(v), **v.params}
    found.pop("MAV_SYS_ID", None)  # the startup sets it after PX4 has set its own
    return {name: int(value) if name in _INTEGERS or (float(value).is_integer() and name.endswith("_ACT")) else float(value)
            for name, value in sorted(found.items())}  # fmt: skip


def _geometry(v: Vehicle) -> dict[str, float]:
    """CA_ROTOR*: where each rotor is and which way it turns (KM is positive for one that turns counter-clockwise)."""
    found: dict[str, float] = {"CA_ROTOR_COUNT": len(v.profile.rotors)}
    for i, rotor in enumerate(v.profile.rotors):
        x, y, _ = rotor.position_m
        turning = 1.0 if rotor.direction == "ccw" else -1.0
        found |= {f"CA_ROTOR{i}_PX": x, f"CA_ROTOR{i}_PY": y, f"CA_ROTOR{i}_KM": turning * v.profile.moment_ratio_m}
    return found
