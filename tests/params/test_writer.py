"""Writing one vehicle's parameters, over the air of simulated time."""

from __future__ import annotations

import math
from typing import Any

import pytest

from arena.wire.mavlink_frame import parse_frames

from .simulated_vehicle import INT32, Air, Vehicle, holds, others, outcomes, reader, rough, run, sixty, writer

SEEDS = range(20)


# -- over a rough wire ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_sixty_are_written_right_in_under_a_minute_with_a_tenth_lost_and_100_ms_of_delay(seed: int) -> None:
    vehicle, core = Vehicle(), writer(others())
    took = run(core, vehicle, rough(seed))
    assert core.ending == "done" and set(outcomes(core).values()) == {"written"}
    assert holds(vehicle, others())
    assert took < 60.0
    old = {name: result.old for name, result in core.result.items()}
    assert old == pytest.approx({name: value for name, (value, _) in sixty().items()})


@pytest.mark.parametrize("seed", SEEDS)
def test_unknown_names_are_told_apart_from_lost_packets_on_a_rough_wire(seed: int) -> None:
    wanted = {**others(), "NO_SUCH": 1.0, "NOR_THIS": 2.0}
    vehicle, core = Vehicle(), writer(wanted)
    assert run(core, vehicle, rough(seed)) < 60.0
    assert {name for name, outcome in outcomes(core).items() if outcome == "unknown"} == {
        "NO_SUCH",
        "NOR_THIS",
    }
    assert set(outcomes(core).values()) == {"written", "unknown"}


@pytest.mark.parametrize("seed", range(5))
def test_a_wire_that_loses_a_third_each_way_still_makes_no_name_unknown(seed: int) -> None:
    vehicle, core = Vehicle(), writer(others())
    run(core, vehicle, Air(seed=seed, loss=0.33, delay_s=0.1, late=0.1), limit_s=300)
    if core.ending == "done":
        assert set(outcomes(core).values()) == {"written"} and holds(vehicle, others())
    else:
        assert core.ending == "vanished" and "unknown" not in outcomes(core).values()


# -- what is sent ---------------------------------------------------------------------------------------------------------------


def test_what_the_vehicle_holds_already_is_not_written() -> None:
    vehicle = Vehicle()
    core = writer({name: value for name, (value, _) in sixty().items()} | {"P_03": 5})
    run(core, vehicle, Air())
    assert vehicle.told == ["P_03"]
    assert outcomes(core).pop("P_03") == "written" and list(outcomes(core).values()).count("same") == 59
    assert core.before == {"P_03": 3} and core.written == {"P_03": 5}


def test_everything_is_read_before_anything_is_written() -> None:
    vehicle, core = Vehicle(), writer(others())
    seen = []
    run(core, vehicle, Air(delay_s=0.02), each=lambda _: seen.append((len(core.before), len(vehicle.told))))
    assert min(before for before, told in seen if told) == 60


def test_a_clean_wire_costs_three_packets_a_parameter_and_a_few_heartbeats() -> None:
    air, core = Air(delay_s=0.01), writer(others())
    run(core, Vehicle(), air)
    assert air.counted["up"] <= 3 * 60 + 5


def test_a_dry_run_writes_nothing_even_on_an_armed_vehicle() -> None:
    vehicle, core = Vehicle(armed=True), writer(others() | {"P_01": 1, "NO_SUCH": 1}, dry_run=True)
    run(core, vehicle, Air())
    assert vehicle.told == [] and core.ending == "done"
    assert (
        outcomes(core)["P_01"] == "same"
        and outcomes(core)["P_00"] == "differs"
        and outcomes(core)["NO_SUCH"] == "unknown"
    )


@pytest.mark.parametrize("value", [3.5, 2.0**31, math.nan, math.inf])
def test_what_an_integer_cannot_be_is_refused_and_not_sent(value: float) -> None:
    vehicle, core = Vehicle(), writer({"P_01": value, "P_03": 7})
    run(core, vehicle, Air())
    assert core.result["P_01"].outcome == "refused" and core.result["P_01"].why.endswith("not sent")
    assert vehicle.told == ["P_03"]


def test_a_float_that_no_parameter_can_hold_is_refused() -> None:
    vehicle, core = Vehicle(), writer({"P_02": 1e39})
    run(core, vehicle, Air())
    assert (
        core.result["P_02"].outcome == "refused"
        and "too large" in core.result["P_02"].why
        and vehicle.told == []
    )


@pytest.mark.parametrize("name", ["", "SEVENTEEN_LETTERS", "P\0", "GRÖSSE", "_HASH_CHECK"])
def test_what_can_be_no_name_is_unknown_and_never_sent(name: str) -> None:
    vehicle, core = Vehicle(), writer({name: 1.0, "P_03": 7})
    run(core, vehicle, Air())
    assert core.result[name].outcome == "unknown" and core.result["P_03"].outcome == "written"
    asked = reader([name, "P_03"])
    run(asked, Vehicle(), Air())
    assert asked.missing == {name: "unknown"} and set(asked.values) == {"P_03"}


# -- what vehicles do -----------------------------------------------------------------------------------------------------------


def test_a_value_that_is_clamped_is_refused_with_what_was_kept() -> None:
    vehicle, core = Vehicle(clamp={"P_03": lambda v: min(v, 10)}), writer({"P_03": 99, "P_05": 6})
    run(core, vehicle, Air(delay_s=0.05))
    assert core.result["P_03"][:4] == ("refused", 99, 3, 10) and core.result["P_05"].outcome == "written"


@pytest.mark.parametrize("seed", SEEDS)
def test_one_that_is_refused_is_told_on_a_rough_wire_and_no_other_is(seed: int) -> None:
    vehicle, core = Vehicle(clamp={"P_03": lambda _: 3}), writer(others())
    run(core, vehicle, rough(seed))
    assert [n for n, o in outcomes(core).items() if o != "written"] == ["P_03"]
    assert core.result["P_03"][:4] == ("refused", others()["P_03"], 3, 3)


@pytest.mark.parametrize("seed", range(5))
def test_a_name_that_appears_only_after_another_was_set_is_written_in_a_later_pass(seed: int) -> None:
    vehicle = Vehicle(params={**sixty(), "LATE": (0, INT32), "LATER": (0, INT32)})
    vehicle.hidden = {"LATE": ("P_01", 4), "LATER": ("LATE", 1)}
    core = writer({"LATER": 2, "LATE": 1, **others(), "NEVER": 1})
    run(core, vehicle, rough(seed))
    assert (
        outcomes(core)["LATE"] == outcomes(core)["LATER"] == "written"
        and outcomes(core)["NEVER"] == "unknown"
    )
    assert vehicle.params["LATER"] == (2, INT32)


def test_a_write_of_another_type_which_px4_meets_with_silence_ends_as_refused() -> None:
    class Stubborn(Vehicle):
        def _answer(self, m: Any) -> list[bytes]:
            return [] if m.get_type() == "PARAM_SET" and m.param_id == "P_03" else super()._answer(m)

    core = writer({"P_03": 9, "P_05": 6})
    vehicle = Stubborn()
    run(core, vehicle, Air(delay_s=0.02))
    assert core.result["P_03"][:4] == ("refused", 9, 3, 3) and core.result["P_05"].outcome == "written"
    assert vehicle.requests < 35, "one silence that is believed is enough"


def test_a_vehicle_that_says_an_error_in_words_is_believed_at_once() -> None:
    slow, quick = writer({"NO_SUCH": 1, "P_03": 9}), writer({"NO_SUCH": 1, "P_03": 9})
    assert run(quick, Vehicle(errors=True), Air(delay_s=0.02)) < run(slow, Vehicle(), Air(delay_s=0.02)) / 2
    assert outcomes(slow) == outcomes(quick) == {"NO_SUCH": "unknown", "P_03": "written"}


def test_a_write_that_is_refused_in_words_is_told_with_them() -> None:
    class Strict(Vehicle):
        def _answer(self, m: Any) -> list[bytes]:
            return (
                [self.error(m.param_id, 2)]
                if m.get_type() == "PARAM_SET" and m.param_id == "P_03"
                else super()._answer(m)
            )

    core = writer({"P_03": 9, "P_05": 6})
    assert run(core, Strict(), Air(delay_s=0.02)) < 2.0
    assert core.result["P_03"] == ("refused", 9, 3, 3, INT32, "the value is out of range")
    assert core.result["P_05"].outcome == "written"


def test_nothing_but_unknown_names_is_found_out_with_a_probe() -> None:
    core = writer({"NO_SUCH": 1})
    run(core, Vehicle(), Air(delay_s=0.02))
    assert outcomes(core) == {"NO_SUCH": "unknown"}


def test_a_vehicle_that_beats_and_answers_nothing_makes_names_lost_and_not_unknown() -> None:
    core = writer({"P_03": 1, "NO_SUCH": 1})
    run(core, Vehicle(answers=False), Air(delay_s=0.02))
    assert outcomes(core) == {"P_03": "lost", "NO_SUCH": "lost"}
    asked = reader(["P_03"])
    run(asked, Vehicle(answers=False), Air())
    assert asked.missing == {"P_03": "lost"}
    listed = reader()
    run(listed, Vehicle(answers=False), Air())
    assert listed.ending == "not heard"


def test_an_outage_of_two_seconds_makes_no_name_unknown() -> None:
    air, core = Air(delay_s=0.02), writer(others())

    def cut_off(now: float) -> None:
        air.loss = 1.0 if 0.2 < now < 2.2 else 0.0

    run(core, Vehicle(), air, each=cut_off)
    assert core.ending == "done" and set(outcomes(core).values()) == {"written"}


def test_values_of_another_vehicle_and_of_another_component_are_not_taken_for_answers() -> None:
    vehicle, stranger = Vehicle(), Vehicle(system=2, params={n: (9, k) for n, (_, k) in sixty().items()})
    core = writer({"P_03": 9})
    camera = Vehicle(params={"P_03": (9, INT32)})
    camera.voice.srcComponent = 100

    def chatter(now: float) -> None:
        for data in (
            stranger.value("P_03"),
            camera.value("P_03"),
            stranger.step(now)[0] if int(now * 100) % 100 == 0 else b"",
        ):
            for frame in parse_frames(data).frames:
                core.hear(data, frame, now)

    run(core, vehicle, Air(delay_s=0.02), each=chatter)
    assert vehicle.params["P_03"] == (9, INT32) and core.result["P_03"][:3] == ("written", 9, 3)


def test_what_another_program_overwrites_before_it_is_read_back_is_written_again_or_told() -> None:
    vehicle, core = Vehicle(), writer({"P_03": 9})
    meddled = []

    def meddle(now: float, times: int) -> None:
        if vehicle.params["P_03"][0] == 9 and len(meddled) < times and core.progress.phase == "reading back":
            meddled.append(now)
            vehicle.params["P_03"] = (4, INT32)

    run(core, vehicle, Air(delay_s=0.05), each=lambda now: meddle(now, 1))
    assert len(meddled) == 1 and core.result["P_03"].outcome == "written" and vehicle.params["P_03"][0] == 9
    vehicle, core = Vehicle(), writer({"P_03": 9})
    meddled.clear()
    run(core, vehicle, Air(delay_s=0.05), each=lambda now: meddle(now, 99))
    assert core.result["P_03"][:4] == ("refused", 9, 3, 4)
