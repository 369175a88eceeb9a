"""Check of PX4 parameters for flights in an indoor arena. Pure.

The parameters come from a file, a log or a vehicle. `RULES` lists every rule. A rule is a function that reads
the parameters of one vehicle and yields findings: what is wrong, why it matters, what to do. Parameters that
are not given count as the version's defaults. A problem caused only by defaults is a note.
"""

from __future__ import annotations

from collections.abc import Mapping

from arena.params.checks import battery, estimator, flight_limits, link_loss, names_and_ranges
from arena.params.checks.findings import CheckContext, Environment, Finding, Rule, Severity
from arena.params.facts.parameter_table import Type, Version

RULES: tuple[Rule, ...] = (
    estimator.estimator_runs,
    estimator.vision_is_fused,
    estimator.height_reference,
    estimator.vision_delay,
    estimator.vision_noise,
    estimator.magnetometer,
    estimator.gps_is_fused,
    estimator.gps_is_required,
    estimator.time_without_aid,
    link_loss.offboard_loss_action,
    link_loss.offboard_loss_action_without_rc,
    link_loss.offboard_loss_time,
    link_loss.rc_input,
    link_loss.rc_loss,
    link_loss.data_link_loss,
    link_loss.motors_stop_in_flight,
    link_loss.return_climbs_into_ceiling,
    link_loss.hold_before_failsafe,
    battery.low_battery,
    battery.battery_thresholds,
    battery.battery_is_measured,
    flight_limits.circuit_breakers,
    flight_limits.attitude_limits,
    flight_limits.landing,
    flight_limits.hover_thrust,
    flight_limits.geofence,
    names_and_ranges.unknown_names,
    names_and_ranges.types_and_ranges,
)
WRITTEN_RULES: tuple[Rule, ...] = (names_and_ranges.unknown_names, names_and_ranges.types_and_ranges)
"""Rules that check each parameter alone, independent of the other parameters."""
_ORDER: tuple[Severity, ...] = ("error", "warning", "note")


def check(
    values: Mapping[str, float],
    version: Version | str,
    *,
    environment: Environment | None = None,
    types: Mapping[str, Type] | None = None,
) -> list[Finding]:
    """Return all findings (problems) of a vehicle's parameters, errors first.

    values: parameter -> value.
    version: PX4 version of the parameters.
    environment: equipment of the arena; by default motion capture, no GPS, no RC.
    types: parameter -> type, if the file has a type column (`ParamSource.types`).
    Raises InputError for a version that is not in the table.
    """
    return _findings(RULES, values, version, environment or Environment(), types or {})


def check_written(values: Mapping[str, float], version: Version | str) -> list[Finding]:
    """Return all findings (problems) of the parameters that a user has written in the YAML.

    Each parameter is checked alone, because the YAML contains only a few of them.

    Finds unknown, renamed and removed parameters (with the most similar name), wrong types, and values outside PX4's limits.
    Raises InputError for a version that is not in the table.
    """
    return _findings(WRITTEN_RULES, values, version, Environment(), {})


def _findings(
    rules: tuple[Rule, ...],
    values: Mapping[str, float],
    version: Version | str,
    environment: Environment,
    types: Mapping[str, Type],
) -> list[Finding]:
    ctx = CheckContext(given=values, version=Version.of(version), environment=environment, types=types)
    found = [finding for rule in rules for finding in rule(ctx)]
    return sorted(found, key=lambda finding: _ORDER.index(finding.severity))


def finding_line(f: Finding) -> str:
    """Return a finding as one line of text: severity, parameter, values, problem, consequence, advice."""
    got = "missing" if f.value is None else f"got {f.value:g}"
    why, fix = (text[:1].upper() + text[1:].rstrip(".") for text in (f.why, f.fix))
    return f"{f.severity}: {f.name}: {got}, expected {f.expected}: {f.problem}. {why}. {fix}."
