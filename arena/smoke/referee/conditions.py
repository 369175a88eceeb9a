"""Evaluates the conditions of a scenario at the newest observation of a flight."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from arena.smoke.language.model import Condition, VehicleState
from arena.smoke.language.vocabulary import QUANTITIES, REAL_TIME_FACTOR
from arena.smoke.referee.flight_history import FlightHistory

Truth = bool | None
UNKNOWN_LIMIT_S = 2.0
"""Longest time for which a value may be unknown before the flight fails [s]. Telemetry counts as unknown when it is 1 s old."""
OFFBOARD = "OFFBOARD"


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Result of a condition at one observation, for one vehicle, pair of vehicles or process.

    This vehicle, pair of vehicles or process is called the subject.

    who: name of the subject, such as `uav1` or `uav1 and uav2`; "" if the condition has none.
    holds: whether the condition is true; None if unknown.
    value: observed value in SI units, if the condition compares a quantity.
    text: observed value as text, if the condition compares no quantity; "" if unknown.
    """

    who: str
    holds: Truth
    value: float | None = None
    text: str = ""


def holds(condition: Condition, flight: FlightHistory) -> Truth:
    """Return whether a condition is true for all its vehicles or processes, or None if this is unknown."""
    truths = [evaluation.holds for evaluation in evaluate(condition, flight)]
    if False in truths:
        return False
    return None if None in truths or not truths else True


def evaluate(condition: Condition, flight: FlightHistory) -> Iterator[Evaluation]:
    """Yield the result of the condition for each subject: vehicle, pair of vehicles or process."""
    for who, holding, value, text in _evaluate(condition, flight):
        turned = holding if holding is None or not condition.negated else not holding
        yield Evaluation(who=who, holds=turned, value=value, text=text)


_Raw = tuple[str, Truth, float | None, str]


def _evaluate(condition: Condition, flight: FlightHistory) -> Iterator[_Raw]:
    if condition.kind == "separation":
        apart = flight.separations()
        for (a, b), distance in apart.items():
            yield f"{a} and {b}", _compare(condition, distance), distance, ""
    elif condition.kind == "event":
        found = [event for event in flight.now.events if condition.texts[0].casefold() in event.casefold()]
        yield "", bool(found), None, f"logged: {found[0]}" if found else "not logged"
    elif condition.kind == REAL_TIME_FACTOR:
        factor = flight.real_time_factor
        yield "", None if factor is None else _compare(condition, factor), factor, ""
    elif condition.kind == "ended":
        yield "", flight.ended, None, "ended" if flight.ended else "running"
    elif condition.kind == "process":
        for name in condition.processes:
            state = flight.now.processes.get(name, "")
            yield name, (state in condition.texts if state else None), None, state
    else:
        for name in condition.vehicles:
            vehicle = flight.now.vehicles.get(name)
            yield (name, None, None, "") if vehicle is None else _of_vehicle(condition, flight, vehicle)


def _of_vehicle(condition: Condition, flight: FlightHistory, vehicle: VehicleState) -> _Raw:
    if condition.operator in {"<", ">"}:
        value = _value(condition.kind, flight, vehicle)
        if value is None or not math.isfinite(value):
            return vehicle.name, None, None, ""
        return vehicle.name, _compare(condition, value), value, ""
    truth, text = _state(condition, flight, vehicle)
    return vehicle.name, truth, None, text


def _state(condition: Condition, flight: FlightHistory, vehicle: VehicleState) -> tuple[Truth, str]:
    kind = condition.kind
    if kind == "mode":
        is_one = vehicle.mode in condition.texts
        return (is_one == (condition.operator == "==")) if vehicle.mode else None, vehicle.mode
    if kind == "airborne":
        return vehicle.airborne, "in the air" if vehicle.airborne else "on the floor"
    if kind == "armed":
        return vehicle.armed, _armed(vehicle)
    if kind == "crashed":
        return bool(vehicle.crashed), f"crashed ({vehicle.crashed})" if vehicle.crashed else "not crashed"
    return _landed(flight, vehicle)


def _landed(flight: FlightHistory, vehicle: VehicleState) -> tuple[Truth, str]:
    if vehicle.airborne:
        return False, f"in the air{f' in {vehicle.mode}' if vehicle.mode else ''}"
    if not flight.flown(vehicle.name):
        return False, "on the floor, not flown yet"
    text = f"on the floor, {_armed(vehicle) or 'armed or not is unknown'}"
    return None if vehicle.armed is None else not vehicle.armed, text


def _armed(vehicle: VehicleState) -> str:
    return "" if vehicle.armed is None else "armed" if vehicle.armed else "disarmed"


def _value(kind: str, flight: FlightHistory, vehicle: VehicleState) -> float | None:
    """Return a quantity of a vehicle in SI units, or None if it is unknown.

    kind: name of the quantity, such as `height`.
    """
    if kind == "height":
        return vehicle.height_m
    if kind == "speed":
        return math.hypot(*vehicle.v_n)
    if kind == "tilt":
        return vehicle.tilt_rad
    if kind == "outside":
        return flight.fence.outside_m(vehicle.p_n)
    if kind == "battery":
        return vehicle.battery
    return _value_from_history(kind, flight, vehicle)


def _value_from_history(kind: str, flight: FlightHistory, vehicle: VehicleState) -> float | None:
    if kind == "touchdown":
        return flight.touchdown_m_s(vehicle.name)
    if kind == "drift":
        return flight.drift_m(vehicle.name)
    if kind == "tracking" and not (vehicle.airborne and vehicle.mode == OFFBOARD):
        return None
    other = vehicle.target_p_n if kind == "tracking" else vehicle.est_p_n
    return None if other is None else math.dist(other, vehicle.p_n)


def _compare(condition: Condition, value: float) -> bool:
    return value < condition.value if condition.operator == "<" else value > condition.value


# -- text for users


def unit(condition: Condition) -> tuple[str, float]:
    """Return the display unit of a condition's value, and its factor to the SI unit."""
    if condition.kind == REAL_TIME_FACTOR:
        return "", 1.0
    quantity = QUANTITIES.get(condition.kind)
    return (quantity.unit, quantity.si) if quantity is not None else ("m", 1.0)


def in_words(condition: Condition, value: float) -> str:
    """Return a value as text with its unit, such as `0.61 m`.

    value: in SI units.
    """
    shown, si = unit(condition)
    value = value / si
    return f"{value:.2f} {shown}".rstrip() if abs(value) < 100 else f"{value:.0f} {shown}"


def subject(condition: Condition, who: str) -> str:
    """Return the name of the compared value, such as `uav1.mode` or `separation between uav1 and uav2`."""
    kind = condition.kind
    if kind == "separation":
        return f"separation between {who}" if who else kind
    if kind == REAL_TIME_FACTOR:
        return kind
    if kind == "tracking":
        return f"tracking({who})"
    if kind in QUANTITIES or kind == "mode":
        return f"{who}.{kind}"
    return who or ("the arena" if kind == "ended" else f'"{condition.texts[0]}"')
