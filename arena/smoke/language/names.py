"""Parsers for names in scenario entries: vehicles, processes and flight modes.

A name must exist in the arena.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from arena.plan.make import process_names
from arena.schema import Arena
from arena.smoke.language.tokens import TokenReader
from arena.smoke.language.vocabulary import (
    EACH,
    MODES,
    SINGLE_PROCESSES,
    UNPLANNED_PROCESSES,
    VEHICLE_PROCESSES,
)
from arena.wire.px4_mode import AUTO


@dataclass(frozen=True, kw_only=True)
class Names:
    """Names that scenario entries may use: the vehicles and processes of the arena.

    rotors: vehicle -> number of rotors.
    """

    vehicles: tuple[str, ...]
    processes: tuple[str, ...]
    rotors: Mapping[str, int] = field(default_factory=dict)


def names_of(arena: Arena) -> Names:
    """Return the names of the vehicles and processes of an arena."""
    return Names(
        vehicles=tuple(v.name for v in arena.vehicles),
        processes=tuple(process_names(arena)),
        rotors={v.name: v.profile.num_rotors for v in arena.vehicles},
    )


def read_vehicles(tokens: TokenReader, names: Names) -> tuple[str, ...]:
    """Parse the name of a vehicle or the word `each`, and return the vehicles.

    Raises WrongWordError for an unknown name.
    """
    found = vehicles_named(tokens, names, tokens.next.text)
    tokens.advance()
    return found


def vehicles_named(tokens: TokenReader, names: Names, name: str) -> tuple[str, ...]:
    """Return the vehicles for a name: one vehicle, or all vehicles for `each`.

    Raises WrongWordError for an unknown name.

    No token is consumed.
    """
    if name == EACH:
        return names.vehicles
    if name not in names.vehicles:
        raise tokens.error(
            f"expected a vehicle of the arena, or {EACH}", _with_rest(tokens, (*names.vehicles, EACH))
        )
    return (name,)


def _with_rest(tokens: TokenReader, vehicles: tuple[str, ...]) -> list[str]:
    _, dot, rest = tokens.next.text.rpartition(".")
    return [f"{v}{dot}{rest if dot else ''}" for v in vehicles]


def read_process(tokens: TokenReader, names: Names) -> tuple[str, ...]:
    """Parse a process such as `program uav1`, and return its name, such as `program.uav1`.

    Returns several names for `program each`. Raises WrongWordError for an unknown process.
    """
    word = tokens.next.text
    if word in VEHICLE_PROCESSES:
        tokens.advance()
        vehicles = vehicles_named(tokens, names, tokens.next.text)
        wanted = [VEHICLE_PROCESSES[word].format(v) for v in vehicles]
        found = tuple(name for name in wanted if name in names.processes)
        if not found:
            raise tokens.error(
                f"expected a vehicle that has a `{word}`; there is no process {wanted[0]} in this arena"
            )
    elif word == "tool":
        tokens.advance()
        tools = [name.removeprefix("tool.") for name in names.processes if name.startswith("tool.")]
        if not tools:
            raise tokens.error(
                "expected a process that is not a tool, because the arena's YAML has no key `tools`"
            )
        if tokens.next.text not in tools:
            raise tokens.error("expected the name of a tool from a key `tools` of the arena's YAML", tools)
        found = (f"tool.{tokens.next.text}",)
    elif word in names.processes or word in UNPLANNED_PROCESSES:
        found = (word,)
    elif word in SINGLE_PROCESSES:
        raise tokens.error(f"expected a process of the arena (the arena has no {word})")
    else:
        raise tokens.error(
            "expected a process of the arena",
            list(dict.fromkeys([*VEHICLE_PROCESSES, *UNPLANNED_PROCESSES, *names.processes])),
        )
    tokens.advance()
    return found


def read_mode(tokens: TokenReader) -> str:
    """Parse a flight mode and return its name, such as `AUTO.LAND`. Raises WrongWordError for an unknown mode."""
    name = tokens.next.text.removeprefix("AUTO.")
    name = "LOITER" if name == "HOLD" else name
    if tokens.next.kind != "word" or name not in MODES:
        raise tokens.error("expected a mode", MODES)
    tokens.advance()
    return f"AUTO.{name}" if name in AUTO.values() else name
