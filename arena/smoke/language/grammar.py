"""What a line of a scenario means: text -> moments, conditions, deeds and rules. The words are in `vocabulary`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from arena.smoke.language.model import Allowance, Condition, Deed, Expectation, Moment, Place, Rule, Sign
from arena.smoke.language.tokens import Words, WrongWordError
from arena.smoke.language.vocabulary import (
    ALONE,
    DEEDS,
    EACH,
    IN_MS,
    MODES,
    OF_VEHICLES,
    PARTS,
    PROCESS_STATES,
    QUANTITIES,
    STATES,
    UNPLANNED,
    Form,
)
from arena.wire.px4_mode import AUTO


@dataclass(frozen=True, kw_only=True)
class Names:
    """What an arena has. rotors: how many each vehicle has."""

    vehicles: tuple[str, ...]
    processes: tuple[str, ...]
    rotors: Mapping[str, int] = field(default_factory=dict)


# -- the entries of a scenario, one function each; all raise WrongWordError ----------------------------------------------------


def read_moment(text: str, names: Names, place: Place) -> Moment:
    """`at:`"""
    words = Words(text)
    condition, then = None, False
    if words.took("then"):
        then = True
    elif not words.took("start"):
        condition = _condition(words, names, place, ("start", "then"))
    after = words.measure("time", "a time", least=0.0) if words.took("+") else 0.0
    words.end("+ a time")
    return Moment(place=place, condition=condition, then=then, after_s=after)


def read_expectation(text: str, names: Names, place: Place) -> Expectation:
    """`expect:`"""
    words = Words(text)
    condition = _condition(words, names, place)
    how = words.one_of(("within", "for"), "`within` a time, or `for` a time")
    time = words.measure("time", "a time", least=0.0)
    words.end()
    return Expectation(place=place, condition=condition, **{f"{how}_s": time})


def read_rule(text: str, names: Names, place: Place) -> Rule:
    """An entry of `always:`."""
    words = Words(text)
    condition = _condition(words, names, place, rule=True)
    if words.next.text in {"within", "for"}:
        raise words.wrong("nothing more: a rule holds all the time")
    words.end()
    return Rule(place=place, condition=condition)


def read_deed(text: str, names: Names, place: Place) -> Deed:
    """`do:`"""
    words = Words(text)
    form, rest = _form(words)
    made: dict[str, object] = {}
    for part in rest:
        _READ_PART.get(part, _literal(part))(words, names, made)
    if form.lasting and words.took("for"):
        made["for_s"] = words.measure("time", "a time", least=0.0)
    if words.next.text == "for":
        raise words.wrong(f"nothing more: `{form.verb}` is not taken back")
    words.end("for a time" if form.lasting and "for_s" not in made else "")
    if form.verb in IN_MS:
        made["number"] = round(float(made["number"]) * 1e3, 6)  # type: ignore[arg-type]
    return Deed(verb=form.verb, place=place, **made)  # type: ignore[arg-type]


def read_allowance(text: str, names: Names) -> Allowance:
    """An entry of `may:`."""
    words = Words(text)
    what = words.one_of(("crash", "fail", "stay"), "`crash` a vehicle, `fail` a process, or `stay up`")
    if what == "stay":
        words.literal("up")
        allowed = Allowance(stay_up=True)
    elif what == "crash":
        allowed = Allowance(crash=frozenset(_vehicles(words, names)))
    else:
        allowed = Allowance(fail=frozenset(_process(words, names)))
    words.end()
    return allowed


# -- conditions ---------------------------------------------------------------------------------------------------------------


def _condition(
    words: Words, names: Names, place: Place, also: tuple[str, ...] = (), *, rule: bool = False
) -> Condition:
    """also: words that might have stood here instead, for the hint."""
    negated = words.took("not")
    made: dict[str, object]
    vehicle, dot, what = words.next.text.rpartition(".") if words.next.kind == "word" else ("", "", "")
    if dot and words.next.text not in names.processes:
        made = _of_vehicle(words, names, vehicle, what)
    elif words.next.text in _ROOM:
        made = _ROOM[words.take().text](words, names)
    elif words.next.text in {*ALONE, *OF_VEHICLES, "tool", *names.processes}:
        made = _of_process(words, names)
    else:
        known = [*also, *_ROOM, "not", *(f"{v}.airborne" for v in names.vehicles), f"{EACH}.airborne", *ALONE]
        raise words.wrong("a condition such as uav1.airborne, separation > 0.8 m or inside geofence", known)
    if rule and made["of"] == "tracking":
        made["rms"] = words.took("rms")
    elif words.next.text == "rms":
        raise words.wrong("no rms: that is over the whole flight, and for `tracking` in a rule alone")
    return Condition(place=place, negated=negated, **made)  # type: ignore[arg-type]


def _of_vehicle(words: Words, names: Names, vehicle: str, what: str) -> dict[str, object]:
    vehicles = _named(words, names, vehicle)
    made: dict[str, object] = {"vehicles": vehicles, "of": what}
    if what == "mode":
        words.take()
        made["sign"] = words.one_of(("==", "!="), "== or != and a mode")
        modes = [_mode(words)]
        while words.took("or"):
            modes.append(_mode(words))
        return {**made, "words": tuple(modes)}
    if what in STATES:
        words.take()
        return made
    quantity = next((q for q in QUANTITIES if q.partition(" ")[0] == what), None)
    if quantity is None:
        near = [f"{vehicle}.{w}" for w in (*STATES, "mode", *(q.partition(" ")[0] for q in QUANTITIES))]
        raise words.wrong("something that is known of a vehicle", near)
    words.take()
    if more := quantity.partition(" ")[2]:
        words.literal(more)
    return {**made, "of": quantity, **_comparison(words, QUANTITIES[quantity].measures)}


def _comparison(words: Words, measures: str) -> dict[str, object]:
    sign: Sign = "<" if words.one_of(("<", ">"), "< or >") == "<" else ">"
    return {"sign": sign, "value": words.measure(measures, "a number")}


def _separation(words: Words, names: Names) -> dict[str, object]:
    if len(names.vehicles) < 2:
        raise WrongWordError("got 'separation', but the arena has one vehicle alone.")
    return {"of": "separation", "vehicles": names.vehicles, **_comparison(words, "distance")}


def _tracking(words: Words, names: Names) -> dict[str, object]:
    words.literal("(")
    vehicles = _vehicles(words, names)
    words.literal(")")
    return {"of": "tracking", "vehicles": vehicles, **_comparison(words, "distance")}


def _inside(words: Words, names: Names) -> dict[str, object]:
    words.literal("geofence")
    return {"of": "outside", "vehicles": names.vehicles, "sign": "<", "value": 0.0}


def _told(words: Words, names: Names) -> dict[str, object]:
    if words.next.kind != "text" or not words.next.text:
        raise words.wrong('what is told, in double quotes, such as told "low battery"')
    return {"of": "told", "words": (words.take().text,)}


def _ended(words: Words, names: Names) -> dict[str, object]:
    words.literal("ended")
    return {"of": "ended"}


_ROOM: dict[str, Callable[[Words, Names], dict[str, object]]] = {
    "separation": _separation,
    "tracking": _tracking,
    "inside": _inside,
    "told": _told,
    "arena": _ended,
}


def _of_process(words: Words, names: Names) -> dict[str, object]:
    processes = _process(words, names)
    words.literal("is")
    state = words.one_of(PROCESS_STATES, f"a state: {', '.join(PROCESS_STATES)}")
    return {"of": "process", "processes": processes, "words": (state,)}


# -- names --------------------------------------------------------------------------------------------------------------------


def _vehicles(words: Words, names: Names) -> tuple[str, ...]:
    found = _named(words, names, words.next.text)
    words.take()
    return found


def _named(words: Words, names: Names, name: str) -> tuple[str, ...]:
    """The vehicles that the next word names, which is not taken."""
    if name == EACH:
        return names.vehicles
    if name not in names.vehicles:
        raise words.wrong(f"a vehicle of the arena, or {EACH}", _with_rest(words, (*names.vehicles, EACH)))
    return (name,)


def _with_rest(words: Words, vehicles: tuple[str, ...]) -> list[str]:
    _, dot, rest = words.next.text.rpartition(".")
    return [f"{v}{dot}{rest if dot else ''}" for v in vehicles]


def _process(words: Words, names: Names) -> tuple[str, ...]:
    """Plan names of what the next words mean."""
    word = words.next.text
    if word in OF_VEHICLES:
        words.take()
        vehicles = _named(words, names, words.next.text)
        wanted = [OF_VEHICLES[word].format(v) for v in vehicles]
        found = tuple(name for name in wanted if name in names.processes)
        if not found:
            raise words.wrong(f"a vehicle with a {word}; the arena has no process {wanted[0]}")
    elif word == "tool":
        words.take()
        tools = [name.removeprefix("tool.") for name in names.processes if name.startswith("tool.")]
        if not tools:
            raise words.wrong("no tool: the arena has none")
        if words.next.text not in tools:
            raise words.wrong("a tool of the arena", tools)
        found = (f"tool.{words.next.text}",)
    elif word in names.processes or word in UNPLANNED:
        found = (word,)
    elif word in ALONE:
        raise words.wrong(f"a process of the arena, which has no {word}")
    else:
        raise words.wrong(
            "a process of the arena", list(dict.fromkeys([*OF_VEHICLES, *UNPLANNED, *names.processes]))
        )
    words.take()
    return found


def _mode(words: Words) -> str:
    """As the autopilot's heartbeat says it: `AUTO.LAND`."""
    name = words.next.text.removeprefix("AUTO.")
    name = "LOITER" if name == "HOLD" else name
    if words.next.kind != "word" or name not in MODES:
        raise words.wrong("a mode", MODES)
    words.take()
    return f"AUTO.{name}" if name in AUTO.values() else name


# -- deeds --------------------------------------------------------------------------------------------------------------------


def _form(words: Words) -> tuple[Form, list[str]]:
    """The form that the next words begin, and its parts that are still to be read."""
    left = [(form, form.form.split()) for form in DEEDS]
    depth = 0
    while len(left) > 1 or depth == 0:
        heads = {parts[depth]: form for form, parts in left}
        open_ = [head for head in heads if head in PARTS]
        if words.next.text not in heads or words.next.kind != "word":
            if not open_:
                expected = "something to do" if depth == 0 else ", ".join(sorted(heads))
                raise words.wrong(expected, sorted(heads))
            left = [(form, parts) for form, parts in left if parts[depth] in open_]
            break
        head = words.take().text
        left = [(form, parts) for form, parts in left if parts[depth] == head]
        depth += 1
    form, parts = left[0]
    return form, parts[depth:]


def _part_vehicles(words: Words, names: Names, made: dict[str, object]) -> None:
    made["vehicles"] = _vehicles(words, names)


def _part_other(words: Words, names: Names, made: dict[str, object]) -> None:
    first = made["vehicles"]
    others = tuple(v for v in names.vehicles if (v,) != first)
    if not isinstance(first, tuple) or len(first) != 1 or words.next.text not in others:
        raise words.wrong("two vehicles by name", others)
    made["vehicles"] = (*first, words.take().text)


def _part_processes(words: Words, names: Names, made: dict[str, object]) -> None:
    made["processes"] = _process(words, names)


def _part_mode(words: Words, names: Names, made: dict[str, object]) -> None:
    made["word"] = _mode(words)


def _part_time(words: Words, names: Names, made: dict[str, object]) -> None:
    made["number"] = words.measure("time", "a time", least=0.0)


def _part_share(words: Words, names: Names, made: dict[str, object]) -> None:
    share = words.next
    made["number"] = value = words.measure("share", "a number", least=0.0)
    if value > 1.0:
        raise WrongWordError(f"got {share.text} %, expected at most 100 %.")


def _part_vector(words: Words, names: Names, made: dict[str, object]) -> None:
    made["by"] = tuple(words.number(f"{axis}, one of three numbers") for axis in ("north", "east", "down"))


def _part_rotor(words: Words, names: Names, made: dict[str, object]) -> None:
    made["number"] = 1.0
    if words.took("rotor"):
        vehicles = made["vehicles"] if isinstance(made["vehicles"], tuple) else ()
        most = min((names.rotors.get(v, 4) for v in vehicles), default=4)
        if words.next.text not in {str(k) for k in range(1, most + 1)}:
            raise words.wrong(f"a rotor, 1 to {most}")
        made["number"] = float(words.take().text)


def _nothing(words: Words, names: Names, made: dict[str, object]) -> None:
    """A part that was read together with the one before."""


_READ_PART: dict[str, Callable[[Words, Names, dict[str, object]], None]] = {
    "V": _part_vehicles,
    "W": _part_other,
    "P": _part_processes,
    "M": _part_mode,
    "T": _part_time,
    "X": _part_share,
    "%": _nothing,
    "N": _part_vector,
    "E": _nothing,
    "D": _nothing,
    "[rotor": _part_rotor,
    "K]": _nothing,
}


def _literal(part: str) -> Callable[[Words, Names, dict[str, object]], None]:
    return lambda words, names, made: words.literal(part)
