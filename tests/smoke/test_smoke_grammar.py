"""Every word of a scenario: what it means, and what is said where it is wrong."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.smoke.language.grammar import (
    Names,
    read_allowance,
    read_deed,
    read_expectation,
    read_moment,
    read_rule,
)
from arena.smoke.language.model import Allowance, Condition, Deed, Expectation, Moment, Place, Rule
from arena.smoke.language.tokens import UNITS, WrongWordError
from arena.smoke.language.vocabulary import DEEDS, MODES, OTHERS, PROCESS_STATES, QUANTITIES, STATES

HERE = Place(file="a.yaml", line=3, text="as written")
NAMES = Names(
    vehicles=("uav1", "uav2"),
    processes=(
        "world",
        "mocap",
        "px4.uav2",
        "forward.uav1",
        "forward.uav2",
        "router",
        "copilot",
        "program.uav1",
        "tool.view",
        "tool.uav1.planner",
    ),
    rotors={"uav1": 4, "uav2": 6},
)

numbers = st.floats(min_value=0.001, max_value=999.0).map(lambda x: round(x, 3))
vehicles = st.sampled_from([("uav1", ("uav1",)), ("uav2", ("uav2",)), ("each", ("uav1", "uav2"))])


def units(kind: str):
    return st.sampled_from([unit for unit, (measures, _) in UNITS.items() if measures == kind])


@st.composite
def conditions(draw) -> tuple[str, Condition]:
    """How it is written, and what it means."""
    text, made = draw(st.one_of(states(), modes(), quantities(), rooms(), processes()))
    negated = draw(st.booleans())
    return ("not " if negated else "") + text, replace(made, negated=negated)


@st.composite
def states(draw):
    (name, who), state = draw(vehicles), draw(st.sampled_from(list(STATES)))
    return f"{name}.{state}", Condition(place=HERE, of=state, vehicles=who)


@st.composite
def modes(draw):
    (name, who), sign = draw(vehicles), draw(st.sampled_from(["==", "!="]))
    given_ = draw(
        st.lists(
            st.sampled_from(["LAND", "AUTO.LAND", "HOLD", "OFFBOARD", "AUTO.LOITER"]), min_size=1, max_size=3
        )
    )
    means = {"LAND": "AUTO.LAND", "HOLD": "AUTO.LOITER"}
    made = Condition(
        place=HERE, of="mode", vehicles=who, sign=sign, words=tuple(means.get(m, m) for m in given_)
    )
    space = draw(st.sampled_from(["", " "]))
    return f"{name}.mode{space}{sign}{space}{' or '.join(given_)}", made


@st.composite
def quantities(draw):
    (name, who), sign, value = draw(vehicles), draw(st.sampled_from(["<", ">"])), draw(numbers)
    quantity = draw(st.sampled_from(list(QUANTITIES)))
    unit = draw(units(QUANTITIES[quantity].measures))
    made = Condition(place=HERE, of=quantity, vehicles=who, sign=sign, value=value * UNITS[unit][1])
    return f"{name}.{quantity} {sign} {value} {unit}", made


@st.composite
def rooms(draw):
    sign, value, (name, who) = draw(st.sampled_from(["<", ">"])), draw(numbers), draw(vehicles)
    return draw(
        st.sampled_from(
            [
                (
                    f"separation {sign} {value} m",
                    Condition(place=HERE, of="separation", vehicles=NAMES.vehicles, sign=sign, value=value),
                ),
                (
                    f"tracking({name}){sign}{value}m",
                    Condition(place=HERE, of="tracking", vehicles=who, sign=sign, value=value),
                ),
                (
                    "inside geofence",
                    Condition(place=HERE, of="outside", vehicles=NAMES.vehicles, sign="<", value=0.0),
                ),
                ('told "low battery, 12 %"', Condition(place=HERE, of="told", words=("low battery, 12 %",))),
                ("arena ended", Condition(place=HERE, of="ended")),
            ]
        )
    )


@st.composite
def processes(draw):
    text, plan = draw(st.sampled_from(list(PROCESSES.items())))
    state = draw(st.sampled_from(PROCESS_STATES))
    return f"{text} is {state}", Condition(place=HERE, of="process", processes=plan, words=(state,))


PROCESSES = {
    "program uav1": ("program.uav1",),
    "program each": ("program.uav1",),
    "forwarder each": ("forward.uav1", "forward.uav2"),
    "px4 uav2": ("px4.uav2",),
    "router": ("router",),
    "mocap": ("mocap",),
    "world": ("world",),
    "supervisor": ("supervisor",),
    "copilot": ("copilot",),
    "tool view": ("tool.view",),
    "tool uav1.planner": ("tool.uav1.planner",),
    "tool.uav1.planner": ("tool.uav1.planner",),
    "forward.uav2": ("forward.uav2",),
}


@given(conditions(), st.sampled_from(["within", "for"]), numbers, units("time"))
def test_an_expectation_is_read_as_it_is_meant(written, how, time, unit) -> None:
    text, condition = written
    found = read_expectation(f"{text} {how} {time} {unit}", NAMES, HERE)
    assert found == Expectation(place=HERE, condition=condition, **{f"{how}_s": time * UNITS[unit][1]})


@given(conditions(), numbers, st.booleans())
def test_a_moment_is_read_as_it_is_meant(written, time, later) -> None:
    text, condition = written
    found = read_moment(f"{text} + {time} s" if later else text, NAMES, HERE)
    assert found == Moment(place=HERE, condition=condition, after_s=time if later else 0.0)


@given(conditions())
def test_a_rule_is_read_as_it_is_meant(written) -> None:
    text, condition = written
    assert read_rule(text, NAMES, HERE) == Rule(place=HERE, condition=condition)


def test_moments_without_a_condition() -> None:
    assert read_moment("start", NAMES, HERE) == Moment(place=HERE)
    assert read_moment("start +3 s", NAMES, HERE) == Moment(place=HERE, after_s=3.0)
    assert read_moment("then + 500 ms", NAMES, HERE) == Moment(place=HERE, then=True, after_s=0.5)


def test_rms_is_of_a_rule_on_tracking() -> None:
    found = read_rule("tracking(uav2) < 0.15 m rms", NAMES, HERE).condition
    assert found.rms and found.vehicles == ("uav2",) and found.value == 0.15


DEEDS_MEANT: dict[str, Deed] = {
    **{f"kill {text}": Deed(verb="kill", place=HERE, processes=plan) for text, plan in PROCESSES.items()},
    "hang router": Deed(verb="hang", place=HERE, processes=("router",)),
    "resume router": Deed(verb="resume", place=HERE, processes=("router",)),
    "restart program uav1": Deed(verb="restart", place=HERE, processes=("program.uav1",)),
    "mocap dropout uav1": Deed(verb="mocap dropout", place=HERE, vehicles=("uav1",)),
    "mocap freeze each for 2 s": Deed(verb="mocap freeze", place=HERE, vehicles=("uav1", "uav2"), for_s=2.0),
    "mocap jump uav1 by 1 0 -2.5 m": Deed(
        verb="mocap jump", place=HERE, vehicles=("uav1",), by=(1.0, 0.0, -2.5)
    ),
    "mocap swap uav2 uav1": Deed(verb="mocap swap", place=HERE, vehicles=("uav2", "uav1")),
    "mocap delay 200 ms": Deed(verb="mocap delay", place=HERE, number=200.0),
    "link loss 30 % uav1 for 500 ms": Deed(
        verb="link loss", place=HERE, vehicles=("uav1",), number=0.3, for_s=0.5
    ),
    "link delay 0.2 s uav1": Deed(verb="link delay", place=HERE, vehicles=("uav1",), number=200.0),
    "rc loss uav2": Deed(verb="rc loss", place=HERE, vehicles=("uav2",)),
    "ground station loss for 9 s": Deed(verb="ground station loss", place=HERE, for_s=9.0),
    "drain battery uav1 in 20 s": Deed(verb="battery drain", place=HERE, vehicles=("uav1",), number=20.0),
    "motor loss uav1": Deed(verb="motor loss", place=HERE, vehicles=("uav1",), number=1.0),
    "motor loss uav2 rotor 6": Deed(verb="motor loss", place=HERE, vehicles=("uav2",), number=6.0),
    "wind 3 0 0 m/s": Deed(verb="wind", place=HERE, by=(3.0, 0.0, 0.0)),
    "wind 3 -1 0.5 m/s for 1 s": Deed(verb="wind", place=HERE, by=(3.0, -1.0, 0.5), for_s=1.0),
    "mode uav1 HOLD": Deed(verb="mode", place=HERE, vehicles=("uav1",), word="AUTO.LOITER"),
    "land all": Deed(verb="land all", place=HERE),
    "kill all": Deed(verb="kill all", place=HERE),
    "down": Deed(verb="down", place=HERE),
}


@pytest.mark.parametrize("text", DEEDS_MEANT)
def test_a_deed_is_read_as_it_is_meant(text: str) -> None:
    assert read_deed(text, NAMES, HERE) == DEEDS_MEANT[text]


def test_every_deed_of_the_table_is_tried_here() -> None:
    assert {deed.verb for deed in DEEDS_MEANT.values()} == {form.verb for form in DEEDS}


@pytest.mark.parametrize("form", DEEDS, ids=lambda form: form.form)
def test_a_deed_is_taken_back_after_a_time_exactly_where_the_table_says_so(form) -> None:
    text = next(text for text, deed in DEEDS_MEANT.items() if deed.verb == form.verb).partition(" for ")[0]
    if form.lasting:
        assert read_deed(f"{text} for 2 s", NAMES, HERE).for_s == 2.0
    else:
        with pytest.raises(WrongWordError, match="is not taken back"):
            read_deed(f"{text} for 2 s", NAMES, HERE)


def test_what_may_happen() -> None:
    assert read_allowance("crash each", NAMES) == Allowance(crash=frozenset({"uav1", "uav2"}))
    assert read_allowance("fail program uav1", NAMES) == Allowance(fail=frozenset({"program.uav1"}))
    assert read_allowance("stay up", NAMES) == Allowance(stay_up=True)


WRONG: dict[str, tuple[object, str, str]] = {
    "moment misspelt": (
        read_moment,
        "strat + 3 s",
        "got 'strat', expected a condition such as uav1.airborne, separation > 0.8 m "
        "or inside geofence. Did you mean start?",
    ),
    "vehicle misspelt": (
        read_moment,
        "uva1.airborne",
        "got 'uva1.airborne', expected a vehicle of the arena, or each. Did you mean uav1.airborne?",
    ),
    "state misspelt": (read_moment, "uav1.airborn", "Did you mean uav1.airborne?"),
    "time without a unit": (
        read_moment,
        "uav1.airborne + 3",
        "got nothing after '3', expected the unit s or ms.",
    ),
    "time that is none": (read_moment, "start + soon", "got 'soon' after '+', expected a time."),
    "no plus": (read_moment, "start 3 s", "got '3' after 'start', expected + a time or nothing more."),
    "minus": (read_moment, "start + -3 s", "got '-3' after '+', expected more than 0 s."),
    "mode misspelt": (
        read_expectation,
        "uav1.mode == LNAD within 2 s",
        "got 'LNAD' after '==', expected a mode. Did you mean LAND?",
    ),
    "assignment": (
        read_expectation,
        "uav1.mode = LAND within 2 s",
        "got '=' after 'uav1.mode', expected == or != and a mode. Write == instead.",
    ),
    "no time": (
        read_expectation,
        "uav1.landed",
        "got nothing after 'uav1.landed', expected `within` a time, or `for` a time.",
    ),
    "within misspelt": (read_expectation, "uav1.landed wihtin 2 s", "Did you mean within?"),
    "two times": (
        read_expectation,
        "uav1.landed within 2 s for 3 s",
        "got 'for' after 's', expected nothing more.",
    ),
    "zero": (read_expectation, "uav1.landed within 0 s", "expected more than 0 s"),
    "at least": (
        read_expectation,
        "uav1.height >= 1 m within 2 s",
        "got '>=' after 'uav1.height', expected < or >. Write > instead.",
    ),
    "wrong unit": (read_rule, "uav1.tilt < 40 m", "got 'm' after '40', expected the unit deg."),
    "rms of something else": (read_rule, "uav1.tilt < 40 deg rms", "expected no rms"),
    "rms in an expectation": (read_expectation, "tracking(uav1) < 1 m rms within 2 s", "expected no rms"),
    "rule with a time": (read_rule, "uav1.tilt < 40 deg for 2 s", "a rule holds all the time"),
    "and": (
        read_rule,
        "uav1.armed && uav2.armed",
        "got '&&' after 'uav1.armed', expected nothing more. Write a further entry instead.",
    ),
    "no parenthesis": (read_rule, "tracking uav2 < 1 m", "got 'uav2' after 'tracking', expected (."),
    "half a quantity": (read_rule, "uav1.estimate < 1 m", "got '<' after 'uav1.estimate', expected error."),
    "unknown": (read_rule, "seperation > 1 m", "Did you mean separation?"),
    "told nothing": (read_rule, "told low", "in double quotes"),
    "unknown state of a process": (read_rule, "router is REDY", "Did you mean READY?"),
    "deed misspelt": (
        read_deed,
        "kil program uav1",
        "got 'kil', expected something to do. Did you mean kill?",
    ),
    "process misspelt": (
        read_deed,
        "kill progrm uav1",
        "got 'progrm' after 'kill', expected a process of the arena. Did you mean program?",
    ),
    "process that is not there": (
        read_deed,
        "kill px4 uav1",
        "a vehicle with a px4; the arena has no process px4.uav1",
    ),
    "tool misspelt": (read_deed, "kill tool veiw", "Did you mean view?"),
    "second word misspelt": (
        read_deed,
        "mocap drpout uav1",
        "got 'drpout' after 'mocap', expected delay, dropout, freeze, jump, swap. Did you mean dropout?",
    ),
    "no third number": (
        read_deed,
        "mocap jump uav1 by 1 0 m",
        "got 'm' after '0', expected down, one of three numbers.",
    ),
    "swap with itself": (
        read_deed,
        "mocap swap uav1 uav1",
        "expected two vehicles by name. Did you mean uav2?",
    ),
    "more than all": (read_deed, "link loss 130 % uav1", "got 130 %, expected at most 100 %."),
    "no such rotor": (
        read_deed,
        "motor loss uav1 rotor 5",
        "got '5' after 'rotor', expected a rotor, 1 to 4.",
    ),
    "nothing to do": (read_deed, "", "got nothing, expected something to do."),
    "huge": (read_deed, "mocap delay 1e400 ms", "a million"),
    "ending": (
        read_deed,
        "mocap dropout uav1 during 2 s",
        "got 'during' after 'uav1', expected for a time or nothing more.",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_word_is_named_with_what_was_expected(name: str) -> None:
    read, text, said = WRONG[name]
    with pytest.raises(WrongWordError) as caught:
        read(text, NAMES, HERE)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_separation_needs_two() -> None:
    with pytest.raises(WrongWordError, match="one vehicle alone"):
        read_rule("separation > 1 m", Names(vehicles=("uav1",), processes=()), HERE)


WORDS = [
    *(word for form in DEEDS for word in form.form.split()),
    *(word for text in OTHERS for word in text.split()),
    *MODES[:3],
    *NAMES.vehicles,
    *NAMES.processes,
    "each",
    "uav1.mode",
    "uav1.height",
    "uav1.estimate",
    "error",
    "rms",
    "within",
    "for",
    "then",
    "start",
    "+",
    "not",
    "or",
    "==",
    "(",
    ")",
    '"',
    "3",
    "-1",
    "1e400",
    "s",
    "ms",
    "m",
    "m/s",
    "%",
    "deg",
    ".",
    "é",
    "\t",
]
READERS = [
    read_moment,
    read_expectation,
    read_rule,
    read_deed,
    lambda text, names, place: read_allowance(text, names),
]


@given(
    st.one_of(st.text(max_size=40), st.lists(st.sampled_from(WORDS), max_size=9).map(" ".join)),
    st.sampled_from(READERS),
)
def test_any_text_is_read_or_refused_in_one_sentence(text, read) -> None:
    try:
        read(text, NAMES, HERE)
    except WrongWordError as error:
        assert "expected" in str(error) or "alone" in str(error)


def test_angles_are_radians_inside() -> None:
    assert math.isclose(read_rule("uav1.tilt < 40 deg", NAMES, HERE).condition.value, math.radians(40))
