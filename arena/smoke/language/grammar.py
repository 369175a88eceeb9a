"""Parser of one scenario entry: text -> trigger, expectation, rule, action or accepted failure.

The module `vocabulary` lists the words of the language.
"""

from __future__ import annotations

from collections.abc import Callable

from arena.smoke.language.model import (
    Action,
    Allowance,
    Condition,
    Expectation,
    Operator,
    Place,
    Rule,
    Trigger,
)
from arena.smoke.language.names import Names, read_mode, read_process, read_vehicles, vehicles_named
from arena.smoke.language.tokens import TokenReader, WrongWordError
from arena.smoke.language.vocabulary import (
    ACTIONS,
    EACH,
    IN_MS,
    OLD_WORDS,
    PARTS,
    PROCESS_STATES,
    QUANTITIES,
    REAL_TIME_FACTOR,
    SINGLE_PROCESSES,
    STATES,
    VEHICLE_PROCESSES,
    Form,
)

# -- the entries of a scenario


def read_trigger(text: str, names: Names, place: Place) -> Trigger:
    """Parse an entry `at`, such as `uav1.airborne + 3 s`. Raises WrongWordError if it is not valid.

    names: names of the arena.  place: file and line of the text.
    """
    tokens = TokenReader(text)
    condition, then = None, False
    if tokens.accept("then"):
        then = True
    elif not tokens.accept("start"):
        condition = _condition(tokens, names, place, ("start", "then"))
    after = tokens.quantity("time", "a time", least=0.0) if tokens.accept("+") else 0.0
    tokens.end("+ a time")
    return Trigger(place=place, condition=condition, then=then, after_s=after)


def read_expectation(text: str, names: Names, place: Place) -> Expectation:
    """Parse an entry `expect`, such as `uav1.landed within 10 s`. Raises WrongWordError if it is not valid.

    names: names of the arena.  place: file and line of the text.
    """
    tokens = TokenReader(text)
    condition = _condition(tokens, names, place)
    how = tokens.one_of(("within", "for"), "`within` a time, or `for` a time")
    time = tokens.quantity("time", "a time", least=0.0)
    tokens.end()
    return Expectation(place=place, condition=condition, **{f"{how}_s": time})


def read_rule(text: str, names: Names, place: Place) -> Rule:
    """Parse an entry of `always`, such as `separation > 0.8 m`. Raises WrongWordError if it is not valid.

    names: names of the arena.  place: file and line of the text.
    """
    tokens = TokenReader(text)
    condition = _condition(tokens, names, place, rule=True)
    if tokens.next.text in {"within", "for"}:
        raise tokens.error(
            "expected the end of the rule, without `within` or `for`, because a rule must hold during the whole flight"
        )
    tokens.end()
    return Rule(place=place, condition=condition)


def read_action(text: str, names: Names, place: Place) -> Action:
    """Parse an entry `do`, such as `kill program uav1`. Raises WrongWordError if it is not valid.

    names: names of the arena.  place: file and line of the text.
    """
    tokens = TokenReader(text)
    form, rest = _form(tokens)
    made: dict[str, object] = {}
    for part in rest:
        _READ_PART.get(part, _literal(part))(tokens, names, made)
    if form.lasting and tokens.accept("for"):
        made["for_s"] = tokens.quantity("time", "a time", least=0.0)
    if tokens.next.text == "for":
        raise tokens.error(f"expected no `for TIME`, because the action `{form.verb}` cannot be undone")
    tokens.end("for a time" if form.lasting and "for_s" not in made else "")
    if form.verb in IN_MS:
        made["number"] = round(float(made["number"]) * 1e3, 6)  # type: ignore[arg-type]
    return Action(verb=form.verb, place=place, **made)  # type: ignore[arg-type]


def read_allowance(text: str, names: Names) -> Allowance:
    """Parse an entry of `may`, such as `crash uav1`: a failure that the scenario accepts.

    Raises WrongWordError if the text is not valid.
    """
    tokens = TokenReader(text)
    what = tokens.one_of(("crash", "fail", "stay"), "`crash` a vehicle, `fail` a process, or `stay up`")
    if what == "stay":
        tokens.expect("up")
        allowed = Allowance(stay_up=True)
    elif what == "crash":
        allowed = Allowance(crash=frozenset(read_vehicles(tokens, names)))
    else:
        allowed = Allowance(fail=frozenset(read_process(tokens, names)))
    tokens.end()
    return allowed


# -- conditions


def _condition(
    tokens: TokenReader, names: Names, place: Place, also: tuple[str, ...] = (), *, rule: bool = False
) -> Condition:
    """Parse a condition, such as `separation > 0.8 m`. Raises WrongWordError if it is not valid.

    also: words other than a condition that are allowed here. They are listed in the error message.
    rule: whether the condition is an entry of `always`.
    """
    negated = tokens.accept("not")
    made: dict[str, object]
    vehicle, dot, what = tokens.next.text.rpartition(".") if tokens.next.kind == "word" else ("", "", "")
    if dot and tokens.next.text not in names.processes:
        made = _of_vehicle(tokens, names, vehicle, what)
    elif tokens.next.text in _OF_ARENA or tokens.next.text in OLD_WORDS:
        word = tokens.advance().text
        made = _OF_ARENA[OLD_WORDS.get(word, word)](tokens, names)
    elif tokens.next.text in {*SINGLE_PROCESSES, *VEHICLE_PROCESSES, "tool", *names.processes}:
        made = _of_process(tokens, names)
    else:
        known = [
            *also,
            *_OF_ARENA,
            "not",
            *(f"{v}.airborne" for v in names.vehicles),
            f"{EACH}.airborne",
            *SINGLE_PROCESSES,
        ]
        raise tokens.error(
            "expected a condition, such as `uav1.airborne`, `separation > 0.8 m` or `inside geofence`", known
        )
    if made["kind"] == REAL_TIME_FACTOR and not rule:
        raise WrongWordError(
            "got 'real time factor', which is allowed only under `always`, because it is measured over the whole flight."
        )
    if rule and made["kind"] == "tracking":
        made["rms"] = tokens.accept("rms")
    elif tokens.next.text == "rms":
        raise tokens.error(
            "expected no `rms`: it is allowed only in a rule under `always`, as in `tracking(uav1) < 0.3 m rms`"
        )
    return Condition(place=place, negated=negated, **made)  # type: ignore[arg-type]


def _of_vehicle(tokens: TokenReader, names: Names, vehicle: str, what: str) -> dict[str, object]:
    vehicles = vehicles_named(tokens, names, vehicle)
    made: dict[str, object] = {"vehicles": vehicles, "kind": what}
    if what == "mode":
        tokens.advance()
        made["operator"] = tokens.one_of(("==", "!="), "== or != and a mode")
        modes = [read_mode(tokens)]
        while tokens.accept("or"):
            modes.append(read_mode(tokens))
        return {**made, "texts": tuple(modes)}
    if what in STATES:
        tokens.advance()
        return made
    quantity = next((q for q in QUANTITIES if q.partition(" ")[0] == what), None)
    if quantity is None:
        near = [f"{vehicle}.{w}" for w in (*STATES, "mode", *(q.partition(" ")[0] for q in QUANTITIES))]
        raise tokens.error(f"expected a state or quantity of a vehicle, such as {vehicle}.airborne", near)
    tokens.advance()
    if more := quantity.partition(" ")[2]:
        tokens.expect(more)
    return {**made, "kind": quantity, **_comparison(tokens, QUANTITIES[quantity].measures)}


def _comparison(tokens: TokenReader, measures: str) -> dict[str, object]:
    operator: Operator = "<" if tokens.one_of(("<", ">"), "< or >") == "<" else ">"
    return {"operator": operator, "value": tokens.quantity(measures, "a number")}


def _separation(tokens: TokenReader, names: Names) -> dict[str, object]:
    if len(names.vehicles) < 2:
        raise WrongWordError("got 'separation', but the arena has only one vehicle.")
    return {"kind": "separation", "vehicles": names.vehicles, **_comparison(tokens, "distance")}


def _tracking(tokens: TokenReader, names: Names) -> dict[str, object]:
    tokens.expect("(")
    vehicles = read_vehicles(tokens, names)
    tokens.expect(")")
    return {"kind": "tracking", "vehicles": vehicles, **_comparison(tokens, "distance")}


def _inside(tokens: TokenReader, names: Names) -> dict[str, object]:
    tokens.expect("geofence")
    return {"kind": "outside", "vehicles": names.vehicles, "operator": "<", "value": 0.0}


def _event(tokens: TokenReader, names: Names) -> dict[str, object]:
    if tokens.next.kind != "text" or not tokens.next.text:
        raise tokens.error('expected the text of an event in double quotes, such as event "low battery"')
    return {"kind": "event", "texts": (tokens.advance().text,)}


def _real_time_factor(tokens: TokenReader, names: Names) -> dict[str, object]:
    for word in REAL_TIME_FACTOR.split()[1:]:
        tokens.expect(word)
    operator: Operator = "<" if tokens.one_of(("<", ">"), "< or >") == "<" else ">"
    return {"kind": REAL_TIME_FACTOR, "operator": operator, "value": tokens.number("a number")}


def _ended(tokens: TokenReader, names: Names) -> dict[str, object]:
    tokens.expect("ended")
    return {"kind": "ended"}


_OF_ARENA: dict[str, Callable[[TokenReader, Names], dict[str, object]]] = {
    "separation": _separation,
    "tracking": _tracking,
    "inside": _inside,
    "event": _event,
    "arena": _ended,
    "real": _real_time_factor,
}


def _of_process(tokens: TokenReader, names: Names) -> dict[str, object]:
    processes = read_process(tokens, names)
    tokens.expect("is")
    state = tokens.one_of(PROCESS_STATES, f"a state: {', '.join(PROCESS_STATES)}")
    return {"kind": "process", "processes": processes, "texts": (state,)}


# -- actions


def _form(tokens: TokenReader) -> tuple[Form, list[str]]:
    """Parse the first words of an action, such as `battery drain`. They determine the kind of action.

    Returns the syntax of the action, and the words of this syntax that are still to be parsed.
    """
    left = [(form, form.form.split()) for form in ACTIONS]
    depth = 0
    while len(left) > 1 or depth == 0:
        heads = {parts[depth]: form for form, parts in left}
        open_ = [head for head in heads if head in PARTS]
        if tokens.next.text not in heads or tokens.next.kind != "word":
            if not open_:
                words = "something to do" if depth == 0 else ", ".join(sorted(heads))
                raise tokens.error(f"expected {words}", sorted(heads))
            left = [(form, parts) for form, parts in left if parts[depth] in open_]
            break
        head = tokens.advance().text
        left = [(form, parts) for form, parts in left if parts[depth] == head]
        depth += 1
    form, parts = left[0]
    return form, parts[depth:]


def _part_vehicles(tokens: TokenReader, names: Names, made: dict[str, object]) -> None:
    made["vehicles"] = read_vehicles(tokens, names)


def _part_other(tokens: TokenReader, names: Names, made: dict[str, object]) -> None:
    first = made["vehicles"]
    others = tuple(v for v in names.vehicles if (v,) != first)
    if not isinstance(first, tuple) or len(first) != 1 or tokens.next.text not in others:
        raise tokens.error("expected the name of a second vehicle", others)
    made["vehicles"] = (*first, tokens.advance().text)


def _part_processes(tokens: TokenReader, names: Names, made: dict[str, object]) -> None:
    made["processes"] = read_process(tokens, names)


def _part_mode(tokens: TokenReader, names: Names, made: dict[str, object]) -> None:
    made["mode"] = read_mode(tokens)


def _part_time(tokens: TokenReader, names: Names, made: dict[str, object]) -> None:
    made["number"] = tokens.quantity("time", "a time", least=0.0)


def _part_share(tokens: TokenReader, names: Names, made: dict[str, object]) -> None:
    share = tokens.next
    made["number"] = value = tokens.quantity("share", "a number", least=0.0)
    if value > 1.0:
        raise WrongWordError(f"got {share.text} %, expected at most 100 %.")


def _part_vector(tokens: TokenReader, names: Names, made: dict[str, object]) -> None:
    made["by"] = tuple(tokens.number(f"{axis}, one of three numbers") for axis in ("north", "east", "down"))


def _part_rotor(tokens: TokenReader, names: Names, made: dict[str, object]) -> None:
    made["number"] = 1.0
    if tokens.accept("rotor"):
        vehicles = made["vehicles"] if isinstance(made["vehicles"], tuple) else ()
        most = min((names.rotors.get(v, 4) for v in vehicles), default=4)
        if tokens.next.text not in {str(k) for k in range(1, most + 1)}:
            raise tokens.error(f"expected the number of a rotor, 1 to {most}")
        made["number"] = float(tokens.advance().text)


def _part_already_parsed(tokens: TokenReader, names: Names, made: dict[str, object]) -> None:
    """Do nothing for a part that was parsed with an earlier part, such as `E` and `D` of `N E D`."""


_READ_PART: dict[str, Callable[[TokenReader, Names, dict[str, object]], None]] = {
    "V": _part_vehicles,
    "W": _part_other,
    "P": _part_processes,
    "M": _part_mode,
    "T": _part_time,
    "X": _part_share,
    "%": _part_already_parsed,
    "N": _part_vector,
    "E": _part_already_parsed,
    "D": _part_already_parsed,
    "[rotor": _part_rotor,
    "K]": _part_already_parsed,
}


def _literal(part: str) -> Callable[[TokenReader, Names, dict[str, object]], None]:
    return lambda tokens, names, made: tokens.expect(part)
