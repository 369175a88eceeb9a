"""A linter of PX4 parameters: what in a file, a log or a vehicle is wrong for an indoor arena, why, and what to do. Pure.

`RULES` is all there is to it: each rule looks at the values of one version and yields what it finds. What is not given is taken
to be the version's default, and what is found about that is a note at most: a file may leave it to the vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping

from arena.params.checks import estimator, failsafes
from arena.params.checks.findings import Finding, Look, Room, Rule, Severity, types_and_ranges, unknown_names
from arena.params.facts.parameter_table import Type, Version

__all__ = ["RULES", "Finding", "Room", "Severity", "check"]

RULES: tuple[Rule, ...] = (
    estimator.estimator_runs,
    estimator.vision_is_fused,
    estimator.height_reference,
    estimator.vision_delay,
    estimator.vision_noise,
    estimator.magnetometer,
    estimator.satellites_fused,
    estimator.satellites_required,
    estimator.blind_time,
    failsafes.offboard_loss_action,
    failsafes.offboard_loss_action_without_sticks,
    failsafes.offboard_loss_time,
    failsafes.sticks_source,
    failsafes.sticks_loss,
    failsafes.data_link,
    failsafes.drops,
    failsafes.returns,
    failsafes.low_battery,
    failsafes.battery_thresholds,
    failsafes.battery_is_measured,
    failsafes.breakers,
    failsafes.attitude_limits,
    failsafes.waits,
    failsafes.landing,
    failsafes.hover_thrust,
    failsafes.fence,
    unknown_names,
    types_and_ranges,
)
_ORDER: tuple[Severity, ...] = ("error", "warning", "note")


def check(
    values: Mapping[str, float],
    version: Version | str,
    *,
    room: Room | None = None,
    types: Mapping[str, Type] | None = None,
) -> list[Finding]:
    """What is wrong, the worst first. types: as the file gives them, where it does (`sources.Source.types`).

    Raises InputError for a version that is not in the table.
    """
    at = Version.of(version)
    look = Look(given=values, version=at, room=room or Room(), types=types or {})
    found = [finding for rule in RULES for finding in rule(look)]
    return sorted(found, key=lambda f: _ORDER.index(f.severity))
