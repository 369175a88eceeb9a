"""Every word of a scenario: its meaning, and the message about a wrong word."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.smoke.language.grammar import (
    read_action,
    read_allowance,
    read_expectation,
    read_rule,
    read_trigger,
)
from arena.smoke.language.model import Action, Allowance, Condition, Expectation, Place, Rule, Trigger
from arena.smoke.language.names import Names
from arena.smoke.language.tokens import UNITS, WrongWordError
from arena.smoke.language.vocabulary import (
    ACTIONS,
    MODES,
    OTHER_CONDITIONS,
    PROCESS_STATES,
    QUANTITIES,
    STATES,
)

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
    """Return a condition as text and as data."""
    text, made = draw(st.one_of(states(), modes(), quantities(), rooms(), processes()))
    negated = draw(st.booleans())
    return ("not " if negated else "") + text, replace(made, negated=negated)


@st.composite
def states(draw):
    (name, who), state = draw(vehicles), draw(st.sampled_from(list(STATES)))
    return f"{name}.{state}", Condition(place=HERE, kind=state, vehicles=who)


@st.composite
def modes(draw):
    (name, who), operator = draw(vehicles), draw(st.sampled_from(["==", "!="]))
    given_ = draw(
        st.lists(
            st.sampled_from(["LAND", "AUTO.LAND", "HOLD", "OFFBOARD", "AUTO.LOITER"]), min_size=1, max_size=3
        )
    )
    means = {"LAND": "AUTO.LAND", "HOLD": "AUTO.LOITER"}
    made = Condition(
        place=HERE, kind="mode", vehicles=who, operator=operator, texts=tuple(means.get(m, m) for m in given_)
    )
    space = draw(st.sampled_from(["", " "]))
    return f"{name}.mode{space}{operator}{space}{' or '.join(given_)}", made


@st.composite
def quantities(draw):
    (name, who), operator, value = draw(vehicles), draw(st.sampled_from(["<", ">"])), draw(numbers)
    quantity = draw(st.sampled_from(list(QUANTITIES)))
    unit = draw(units(QUANTITIES[quantity].measures))
    made = Condition(place=HERE, kind=quantity, vehicles=who, operator=operator, value=value * UNITS[unit][1])
    return f"{name}.{quantity} {operator} {value} {unit}", made


@st.composite
def rooms(draw):
    operator, value, (name, who) = draw(st.sampled_from(["<", ">"])), draw(numbers), draw(vehicles)
    return draw(
        st.sampled_from(
            [
                (
                    f"separation {operator} {value} m",
                    Condition(
                        place=HERE, kind="separation", vehicles=NAMES.vehicles, operator=operator, value=value
                    ),
                ),
                (
                    f"tracking({name}){operator}{value}m",
                    Condition(place=HERE, kind="tracking", vehicles=who, operator=operator, value=value),
                ),
                (
                    "inside geofence",
                    Condition(place=HERE, kind="outside", vehicles=NAMES.vehicles, operator="<", value=0.0),
                ),
                (
                    'event "low battery, 12 %"',
                    Condition(place=HERE, kind="event", texts=("low battery, 12 %",)),
                ),
                ("arena ended", Condition(place=HERE, kind="ended")),
            ]
        )
    )


@st.composite
def processes(draw):
    text, plan = draw(st.sampled_from(list(PROCESSES.items())))
    state = draw(st.sampled_from(PROCESS_STATES))
    return f"{text} is {state}", Condition(place=HERE, kind="process", processes=plan, texts=(state,))


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
def test_expectation_is_parsed(written, how, time, unit) -> None:
    text, condition = written
    found = read_expectation(f"{text} {how} {time} {unit}", NAMES, HERE)
    assert found == Expectation(place=HERE, condition=condition, **{f"{how}_s": time * UNITS[unit][1]})


@given(conditions(), numbers, st.booleans())
def test_trigger_is_parsed(written, time, later) -> None:
    text, condition = written
    found = read_trigger(f"{text} + {time} s" if later else text, NAMES, HERE)
    assert found == Trigger(place=HERE, condition=condition, after_s=time if later else 0.0)


@given(conditions())
def test_rule_is_parsed(written) -> None:
    text, condition = written
    assert read_rule(text, NAMES, HERE) == Rule(place=HERE, condition=condition)


def test_trigger_without_a_condition_is_parsed() -> None:
    assert read_trigger("start", NAMES, HERE) == Trigger(place=HERE)
    assert read_trigger("start +3 s", NAMES, HERE) == Trigger(place=HERE, after_s=3.0)
    assert read_trigger("then + 500 ms", NAMES, HERE) == Trigger(place=HERE, then=True, after_s=0.5)


def test_old_word_for_an_event_is_still_read() -> None:
    assert read_rule('not told "low"', NAMES, HERE) == read_rule('not event "low"', NAMES, HERE)


def test_real_time_factor_is_a_rule_without_a_unit() -> None:
    found = read_rule("real time factor > 0.95", NAMES, HERE).condition
    assert (found.kind, found.operator, found.value) == ("real time factor", ">", 0.95)
    with pytest.raises(WrongWordError, match="allowed only under `always`"):
        read_expectation("real time factor > 0.95 within 2 s", NAMES, HERE)


def test_rms_is_part_of_a_rule_on_tracking() -> None:
    found = read_rule("tracking(uav2) < 0.15 m rms", NAMES, HERE).condition
    assert found.rms and found.vehicles == ("uav2",) and found.value == 0.15


ACTIONS_MEANT: dict[str, Action] = {
    **{f"kill {text}": Action(verb="kill", place=HERE, processes=plan) for text, plan in PROCESSES.items()},
    "hang router": Action(verb="hang", place=HERE, processes=("router",)),
    "resume router": Action(verb="resume", place=HERE, processes=("router",)),
    "restart program uav1": Action(verb="restart", place=HERE, processes=("program.uav1",)),
    "mocap dropout uav1": Action(verb="mocap dropout", place=HERE, vehicles=("uav1",)),
    "mocap freeze each for 2 s": Action(
        verb="mocap freeze", place=HERE, vehicles=("uav1", "uav2"), for_s=2.0
    ),
    "mocap jump uav1 by 1 0 -2.5 m": Action(
        verb="mocap jump", place=HERE, vehicles=("uav1",), by=(1.0, 0.0, -2.5)
    ),
    "mocap swap uav2 uav1": Action(verb="mocap swap", place=HERE, vehicles=("uav2", "uav1")),
    "mocap delay 200 ms": Action(verb="mocap delay", place=HERE, number=200.0),
    "link loss 30 % uav1 for 500 ms": Action(
        verb="link loss", place=HERE, vehicles=("uav1",), number=0.3, for_s=0.5
    ),
    "link delay 0.2 s uav1": Action(verb="link delay", place=HERE, vehicles=("uav1",), number=200.0),
    "rc loss uav2": Action(verb="rc loss", place=HERE, vehicles=("uav2",)),
    "ground station loss for 9 s": Action(verb="ground station loss", place=HERE, for_s=9.0),
    "drain battery uav1 in 20 s": Action(verb="battery drain", place=HERE, vehicles=("uav1",), number=20.0),
    "motor loss uav1": Action(verb="motor loss", place=HERE, vehicles=("uav1",), number=1.0),
    "motor loss uav2 rotor 6": Action(verb="motor loss", place=HERE, vehicles=("uav2",), number=6.0),
    "wind 3 0 0 m/s": Action(verb="wind", place=HERE, by=(3.0, 0.0, 0.0)),
    "wind 3 -1 0.5 m/s for 1 s": Action(verb="wind", place=HERE, by=(3.0, -1.0, 0.5), for_s=1.0),
    "mode uav1 HOLD": Action(verb="mode", place=HERE, vehicles=("uav1",), mode="AUTO.LOITER"),
    "land all": Action(verb="land all", place=HERE),
    "kill all": Action(verb="kill all", place=HERE),
    "down": Action(verb="down", place=HERE),
}


@pytest.mark.parametrize("text", ACTIONS_MEANT)
def test_action_is_parsed(text: str) -> None:
    assert read_action(text, NAMES, HERE) == ACTIONS_MEANT[text]


def test_every_action_of_the_table_is_tested() -> None:
    assert {action.verb for action in ACTIONS_MEANT.values()} == {form.verb for form in ACTIONS}


@pytest.mark.parametrize("form", ACTIONS, ids=lambda form: form.form)
def test_only_lasting_actions_take_a_time(form) -> None:
    text = next(text for text, action in ACTIONS_MEANT.items() if action.verb == form.verb).partition(
        " for "
    )[0]
    if form.lasting:
        assert read_action(f"{text} for 2 s", NAMES, HERE).for_s == 2.0
    else:
        with pytest.raises(WrongWordError, match="cannot be undone"):
            read_action(f"{text} for 2 s", NAMES, HERE)


def test_allowance_is_parsed() -> None:
    assert read_allowance("crash each", NAMES) == Allowance(crash=frozenset({"uav1", "uav2"}))
    assert read_allowance("fail program uav1", NAMES) == Allowance(fail=frozenset({"program.uav1"}))
    assert read_allowance("stay up", NAMES) == Allowance(stay_up=True)


WRONG: dict[str, tuple[object, str, str]] = {
    "trigger misspelt": (
        read_trigger,
        "strat + 3 s",
        "got 'strat', expected a condition, such as `uav1.airborne`, `separation > 0.8 m` "
        "or `inside geofence`. Did you mean start?",
    ),
    "vehicle misspelt": (
        read_trigger,
        "uva1.airborne",
        "got 'uva1.airborne', expected a vehicle of the arena, or each. Did you mean uav1.airborne?",
    ),
    "state misspelt": (read_trigger, "uav1.airborn", "Did you mean uav1.airborne?"),
    "time without a unit": (
        read_trigger,
        "uav1.airborne + 3",
        "got nothing after '3', expected the unit s or ms.",
    ),
    "time that is none": (read_trigger, "start + soon", "got 'soon' after '+', expected a time."),
    "no plus": (read_trigger, "start 3 s", "got '3' after 'start', expected + a time or nothing more."),
    "minus": (read_trigger, "start + -3 s", "got '-3' after '+', expected more than 0 s."),
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
    "rms of something else": (read_rule, "uav1.tilt < 40 deg rms", "expected no `rms`"),
    "rms in an expectation": (read_expectation, "tracking(uav1) < 1 m rms within 2 s", "expected no `rms`"),
    "rule with a time": (read_rule, "uav1.tilt < 40 deg for 2 s", "a rule must hold during the whole flight"),
    "and": (
        read_rule,
        "uav1.armed && uav2.armed",
        "got '&&' after 'uav1.armed', expected nothing more. Write a further entry instead.",
    ),
    "no parenthesis": (read_rule, "tracking uav2 < 1 m", "got 'uav2' after 'tracking', expected (."),
    "half a quantity": (read_rule, "uav1.estimate < 1 m", "got '<' after 'uav1.estimate', expected error."),
    "unknown": (read_rule, "seperation > 1 m", "Did you mean separation?"),
    "event without quotes": (read_rule, "event low", "in double quotes"),
    "unknown state of a process": (read_rule, "router is REDY", "Did you mean READY?"),
    "action misspelt": (
        read_action,
        "kil program uav1",
        "got 'kil', expected something to do. Did you mean kill?",
    ),
    "process misspelt": (
        read_action,
        "kill progrm uav1",
        "got 'progrm' after 'kill', expected a process of the arena. Did you mean program?",
    ),
    "process that is not there": (
        read_action,
        "kill px4 uav1",
        "a vehicle that has a `px4`; there is no process px4.uav1 in this arena",
    ),
    "tool misspelt": (read_action, "kill tool veiw", "Did you mean view?"),
    "second word misspelt": (
        read_action,
        "mocap drpout uav1",
        "got 'drpout' after 'mocap', expected delay, dropout, freeze, jump, swap. Did you mean dropout?",
    ),
    "no third number": (
        read_action,
        "mocap jump uav1 by 1 0 m",
        "got 'm' after '0', expected down, one of three numbers.",
    ),
    "swap with itself": (
        read_action,
        "mocap swap uav1 uav1",
        "expected the name of a second vehicle. Did you mean uav2?",
    ),
    "more than all": (read_action, "link loss 130 % uav1", "got 130 %, expected at most 100 %."),
    "no such rotor": (
        read_action,
        "motor loss uav1 rotor 5",
        "got '5' after 'rotor', expected the number of a rotor, 1 to 4.",
    ),
    "nothing to do": (read_action, "", "got nothing, expected something to do."),
    "huge": (read_action, "mocap delay 1e400 ms", "expected a time between -1000000 and 1000000"),
    "ending": (
        read_action,
        "mocap dropout uav1 during 2 s",
        "got 'during' after 'uav1', expected for a time or nothing more.",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_word_is_named_with_the_expected_ones(name: str) -> None:
    read, text, message = WRONG[name]
    with pytest.raises(WrongWordError) as caught:
        read(text, NAMES, HERE)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_separation_needs_two_vehicles() -> None:
    with pytest.raises(WrongWordError, match="only one vehicle"):
        read_rule("separation > 1 m", Names(vehicles=("uav1",), processes=()), HERE)


WORDS = [
    *(word for form in ACTIONS for word in form.form.split()),
    *(word for text in OTHER_CONDITIONS for word in text.split()),
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
    read_trigger,
    read_expectation,
    read_rule,
    read_action,
    lambda text, names, place: read_allowance(text, names),
]


@given(
    st.one_of(st.text(max_size=40), st.lists(st.sampled_from(WORDS), max_size=9).map(" ".join)),
    st.sampled_from(READERS),
)
def test_any_text_is_parsed_or_refused(text, read) -> None:
    try:
        read(text, NAMES, HERE)
    except WrongWordError as error:
        assert "expected" in str(error) or "only one vehicle" in str(error)


def test_angles_are_converted_to_radians() -> None:
    assert math.isclose(read_rule("uav1.tilt < 40 deg", NAMES, HERE).condition.value, math.radians(40))
