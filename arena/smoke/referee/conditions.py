"""Whether a condition holds at a look, and what was seen of it. Unknown is neither: None."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from arena.smoke.language.model import Condition, VehicleNow
from arena.smoke.language.vocabulary import QUANTITIES
from arena.smoke.referee.flight_history import Flight

Truth = bool | None
_OFFBOARD = "OFFBOARD"


@dataclass(frozen=True, kw_only=True)
class Seen:
    """One thing at one look. who: a vehicle, a pair in words, a process, or ""; value: of a quantity, in SI; words: of anything
    else, "" when it was not heard.
    """

    who: str
    holds: Truth
    value: float | None = None
    words: str = ""


def holds(condition: Condition, flight: Flight) -> Truth:
    """For all that it names."""
    truths = [seen.holds for seen in look(condition, flight)]
    if False in truths:
        return False
    return None if None in truths or not truths else True


def look(condition: Condition, flight: Flight) -> Iterator[Seen]:
    """What is seen of each thing that the condition names."""
    for who, holding, value, words in _look(condition, flight):
        turned = holding if holding is None or not condition.negated else not holding
        yield Seen(who=who, holds=turned, value=value, words=words)


_Raw = tuple[str, Truth, float | None, str]


def _look(condition: Condition, flight: Flight) -> Iterator[_Raw]:
    if condition.of == "separation":
        apart = flight.separations()
        for (a, b), distance in apart.items():
            yield f"{a} and {b}", _compare(condition, distance), distance, ""
    elif condition.of == "told":
        found = [event for event in flight.now.events if condition.words[0].casefold() in event.casefold()]
        yield "", bool(found), None, f"told: {found[0]}" if found else "not told"
    elif condition.of == "ended":
        yield "", flight.ended, None, "ended" if flight.ended else "there"
    elif condition.of == "process":
        for name in condition.processes:
            state = flight.now.processes.get(name, "")
            yield name, (state in condition.words if state else None), None, state
    else:
        for name in condition.vehicles:
            vehicle = flight.now.vehicles.get(name)
            yield (name, None, None, "") if vehicle is None else _of_vehicle(condition, flight, vehicle)


def _of_vehicle(condition: Condition, flight: Flight, vehicle: VehicleNow) -> _Raw:
    if condition.sign in {"<", ">"}:
        value = _value(condition.of, flight, vehicle)
        if value is None or not math.isfinite(value):
            return vehicle.name, None, None, ""
        return vehicle.name, _compare(condition, value), value, ""
    truth, words = _state(condition, flight, vehicle)
    return vehicle.name, truth, None, words


def _state(condition: Condition, flight: Flight, vehicle: VehicleNow) -> tuple[Truth, str]:
    of = condition.of
    if of == "mode":
        is_one = vehicle.mode in condition.words
        return (is_one == (condition.sign == "==")) if vehicle.mode else None, vehicle.mode
    if of == "airborne":
        return vehicle.airborne, "in the air" if vehicle.airborne else "on the floor"
    if of == "armed":
        return vehicle.armed, _armed(vehicle)
    if of == "crashed":
        return bool(vehicle.crashed), f"crashed ({vehicle.crashed})" if vehicle.crashed else "not crashed"
    return _landed(flight, vehicle)


def _landed(flight: Flight, vehicle: VehicleNow) -> tuple[Truth, str]:
    if vehicle.airborne:
        return False, f"in the air{f' in {vehicle.mode}' if vehicle.mode else ''}"
    if not flight.flown(vehicle.name):
        return False, "on the floor, not flown yet"
    words = f"on the floor, {_armed(vehicle) or 'not heard whether disarmed'}"
    return None if vehicle.armed is None else not vehicle.armed, words


def _armed(vehicle: VehicleNow) -> str:
    return "" if vehicle.armed is None else "armed" if vehicle.armed else "disarmed"


def _value(of: str, flight: Flight, vehicle: VehicleNow) -> float | None:
    """In SI; None: unknown."""
    if of == "height":
        return vehicle.height_m
    if of == "speed":
        return math.hypot(*vehicle.v_n)
    if of == "tilt":
        return vehicle.tilt_rad
    if of == "outside":
        return flight.fence.outside_m(vehicle.p_n)
    if of == "battery":
        return vehicle.battery
    return _of_memory(of, flight, vehicle)


def _of_memory(of: str, flight: Flight, vehicle: VehicleNow) -> float | None:
    if of == "touchdown":
        return flight.touchdown_m_s(vehicle.name)
    if of == "drift":
        return flight.drift_m(vehicle.name)
    if of == "tracking" and not (vehicle.airborne and vehicle.mode == _OFFBOARD):
        return None
    other = vehicle.target_p_n if of == "tracking" else vehicle.est_p_n
    return None if other is None else math.dist(other, vehicle.p_n)


def _compare(condition: Condition, value: float) -> bool:
    return value < condition.value if condition.sign == "<" else value > condition.value


# -- for people ---------------------------------------------------------------------------------------------------------------


def unit(condition: Condition) -> tuple[str, float]:
    """What people are shown, and how much of the SI unit one of it is."""
    quantity = QUANTITIES.get(condition.of)
    return (quantity.unit, quantity.si) if quantity is not None else ("m", 1.0)


def in_words(condition: Condition, value: float) -> str:
    """A value in the unit that people are shown: `0.61 m`."""
    shown, si = unit(condition)
    value = value / si
    return f"{value:.2f} {shown}" if abs(value) < 100 else f"{value:.0f} {shown}"


def subject(condition: Condition, who: str) -> str:
    """What the value or the words are of: `uav1.mode`, `separation between uav1 and uav2`."""
    of = condition.of
    if of == "separation":
        return f"separation between {who}" if who else of
    if of == "tracking":
        return f"tracking({who})"
    if of in QUANTITIES or of == "mode":
        return f"{who}.{of}"
    return who or ("the arena" if of == "ended" else f'"{condition.words[0]}"')
