"""Tests of writing one vehicle's parameters over a simulated link."""

from __future__ import annotations

import math

import pytest
from fake_autopilot import INT32
from served import LossyLink

from arena.wire.mavlink_frame import parse_frames

from .simulated_transfer import (
    holds,
    lossy_link,
    new_values,
    outcomes,
    reader,
    run,
    sixty_params,
    vehicle,
    writer,
)

SEEDS = range(20)


# -- over a lossy link ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_sixty_parameters_are_written_within_60_s_over_a_lossy_link(seed: int) -> None:
    autopilot, core = vehicle(), writer(new_values())
    took = run(core, autopilot, lossy_link(seed))
    assert core.ending == "done" and set(outcomes(core).values()) == {"written"}
    assert holds(autopilot, new_values())
    assert took < 60.0
    old = {name: result.old for name, result in core.result.items()}
    assert old == pytest.approx({name: value for name, (value, _) in sixty_params().items()})


@pytest.mark.parametrize("seed", SEEDS)
def test_unknown_names_differ_from_lost_packets(seed: int) -> None:
    wanted = {**new_values(), "NO_SUCH": 1.0, "NOR_THIS": 2.0}
    autopilot, core = vehicle(), writer(wanted)
    assert run(core, autopilot, lossy_link(seed)) < 60.0
    assert {name for name, outcome in outcomes(core).items() if outcome == "unknown"} == {
        "NO_SUCH",
        "NOR_THIS",
    }
    assert set(outcomes(core).values()) == {"written", "unknown"}


@pytest.mark.parametrize("seed", range(5))
def test_a_third_lost_each_way_makes_no_name_unknown(seed: int) -> None:
    autopilot, core = vehicle(), writer(new_values())
    run(core, autopilot, LossyLink(seed=seed, loss=0.33, delay_s=0.1, late=0.1), limit_s=300)
    if core.ending == "done":
        assert set(outcomes(core).values()) == {"written"} and holds(autopilot, new_values())
    else:
        assert core.ending == "connection lost" and "unknown" not in outcomes(core).values()


# -- what is sent ---------------------------------------------------------------------------------------------------------------


def test_equal_values_are_not_written() -> None:
    autopilot = vehicle()
    core = writer({name: value for name, (value, _) in sixty_params().items()} | {"P_03": 5})
    run(core, autopilot, LossyLink())
    assert autopilot.written_names == ["P_03"]
    assert outcomes(core).pop("P_03") == "written" and list(outcomes(core).values()).count("same") == 59
    assert core.before == {"P_03": 3} and core.written == {"P_03": 5}


def test_everything_is_read_before_the_first_write() -> None:
    autopilot, core = vehicle(), writer(new_values())
    seen = []
    run(
        core,
        autopilot,
        LossyLink(delay_s=0.02),
        each=lambda _: seen.append((len(core.before), len(autopilot.written_names))),
    )
    assert min(before for before, written in seen if written) == 60


def test_clean_link_needs_three_packets_per_parameter() -> None:
    link, core = LossyLink(delay_s=0.01), writer(new_values())
    run(core, vehicle(), link)
    assert link.counted["up"] <= 3 * 60 + 5


def test_dry_run_writes_nothing_and_accepts_an_armed_vehicle() -> None:
    autopilot, core = vehicle(armed=True), writer(new_values() | {"P_01": 1, "NO_SUCH": 1}, dry_run=True)
    run(core, autopilot, LossyLink())
    assert autopilot.written_names == [] and core.ending == "done"
    assert (
        outcomes(core)["P_01"] == "same"
        and outcomes(core)["P_00"] == "differs"
        and outcomes(core)["NO_SUCH"] == "unknown"
    )


@pytest.mark.parametrize("value", [3.5, 2.0**31, math.nan, math.inf])
def test_value_that_an_integer_cannot_hold_is_not_sent(value: float) -> None:
    autopilot, core = vehicle(), writer({"P_01": value, "P_03": 7})
    run(core, autopilot, LossyLink())
    assert core.result["P_01"].outcome == "refused" and core.result["P_01"].why.endswith("not sent")
    assert autopilot.written_names == ["P_03"]


def test_too_large_float_is_refused() -> None:
    autopilot, core = vehicle(), writer({"P_02": 1e39})
    run(core, autopilot, LossyLink())
    assert (
        core.result["P_02"].outcome == "refused"
        and "too large" in core.result["P_02"].why
        and autopilot.written_names == []
    )


@pytest.mark.parametrize("name", ["", "SEVENTEEN_LETTERS", "P\0", "GRÖSSE", "_HASH_CHECK"])
def test_invalid_name_is_unknown_and_not_sent(name: str) -> None:
    autopilot, core = vehicle(), writer({name: 1.0, "P_03": 7})
    run(core, autopilot, LossyLink())
    assert core.result[name].outcome == "unknown" and core.result["P_03"].outcome == "written"
    asked = reader([name, "P_03"])
    run(asked, vehicle(), LossyLink())
    assert asked.missing == {name: "unknown"} and set(asked.values) == {"P_03"}


# -- what vehicles do -----------------------------------------------------------------------------------------------------------


def test_clamped_value_is_refused_with_the_kept_value() -> None:
    autopilot, core = vehicle(clamp={"P_03": lambda v: min(v, 10)}), writer({"P_03": 99, "P_05": 6})
    run(core, autopilot, LossyLink(delay_s=0.05))
    assert core.result["P_03"][:4] == ("refused", 99, 3, 10) and core.result["P_05"].outcome == "written"


@pytest.mark.parametrize("seed", SEEDS)
def test_only_the_refused_parameter_is_refused_on_a_lossy_link(seed: int) -> None:
    autopilot, core = vehicle(clamp={"P_03": lambda _: 3}), writer(new_values())
    run(core, autopilot, lossy_link(seed))
    assert [n for n, o in outcomes(core).items() if o != "written"] == ["P_03"]
    assert core.result["P_03"][:4] == ("refused", new_values()["P_03"], 3, 3)


@pytest.mark.parametrize("seed", range(5))
def test_parameter_that_appears_after_another_write_is_written(seed: int) -> None:
    autopilot = vehicle(params={**sixty_params(), "LATE": (0, INT32), "LATER": (0, INT32)})
    autopilot.hidden = {"LATE": ("P_01", 4), "LATER": ("LATE", 1)}
    core = writer({"LATER": 2, "LATE": 1, **new_values(), "NEVER": 1})
    run(core, autopilot, lossy_link(seed))
    assert (
        outcomes(core)["LATE"] == outcomes(core)["LATER"] == "written"
        and outcomes(core)["NEVER"] == "unknown"
    )
    assert autopilot.params["LATER"] == (2, INT32)


def test_unanswered_write_of_an_answering_vehicle_is_refused() -> None:
    core = writer({"P_03": 9, "P_05": 6})
    autopilot = vehicle(refused_writes={"P_03": None})
    run(core, autopilot, LossyLink(delay_s=0.02))
    assert core.result["P_03"][:4] == ("refused", 9, 3, 3) and core.result["P_05"].outcome == "written"
    assert autopilot.requests < 35, "the write is not repeated after it counts as ignored"


def test_param_error_ends_a_request_at_once() -> None:
    slow, quick = writer({"NO_SUCH": 1, "P_03": 9}), writer({"NO_SUCH": 1, "P_03": 9})
    assert (
        run(quick, vehicle(errors=True), LossyLink(delay_s=0.02))
        < run(slow, vehicle(), LossyLink(delay_s=0.02)) / 2
    )
    assert outcomes(slow) == outcomes(quick) == {"NO_SUCH": "unknown", "P_03": "written"}


def test_param_error_of_a_write_gives_the_reason() -> None:
    core = writer({"P_03": 9, "P_05": 6})
    assert run(core, vehicle(refused_writes={"P_03": 2}), LossyLink(delay_s=0.02)) < 2.0
    assert core.result["P_03"] == ("refused", 9, 3, 3, INT32, "the value is out of range")
    assert core.result["P_05"].outcome == "written"


def test_only_unknown_names_are_found_with_a_probe() -> None:
    core = writer({"NO_SUCH": 1})
    run(core, vehicle(), LossyLink(delay_s=0.02))
    assert outcomes(core) == {"NO_SUCH": "unknown"}


def test_vehicle_without_answers_makes_names_unanswered() -> None:
    core = writer({"P_03": 1, "NO_SUCH": 1})
    run(core, vehicle(answers=False), LossyLink(delay_s=0.02))
    assert outcomes(core) == {"P_03": "unanswered", "NO_SUCH": "unanswered"}
    asked = reader(["P_03"])
    run(asked, vehicle(answers=False), LossyLink())
    assert asked.missing == {"P_03": "unanswered"}
    listed = reader()
    run(listed, vehicle(answers=False), LossyLink())
    assert listed.ending == "no connection"


def test_outage_of_2_s_makes_no_name_unknown() -> None:
    link, core = LossyLink(delay_s=0.02), writer(new_values())

    def cut_off(now: float) -> None:
        link.loss = 1.0 if 0.2 < now < 2.2 else 0.0

    run(core, vehicle(), link, each=cut_off)
    assert core.ending == "done" and set(outcomes(core).values()) == {"written"}


def test_values_of_other_vehicles_and_components_are_ignored() -> None:
    autopilot, other_vehicle = (
        vehicle(),
        vehicle(2, params={n: (9, k) for n, (_, k) in sixty_params().items()}),
    )
    core = writer({"P_03": 9})
    camera = vehicle(params={"P_03": (9, INT32)})
    camera.encoder.srcComponent = 100

    def chatter(now: float) -> None:
        for data in (
            other_vehicle.value("P_03"),
            camera.value("P_03"),
            other_vehicle.step(now)[0] if int(now * 100) % 100 == 0 else b"",
        ):
            for frame in parse_frames(data).frames:
                core.receive(data, frame, now)

    run(core, autopilot, LossyLink(delay_s=0.02), each=chatter)
    assert autopilot.params["P_03"] == (9, INT32) and core.result["P_03"][:3] == ("written", 9, 3)


def test_value_overwritten_by_another_program_is_written_again() -> None:
    autopilot, core = vehicle(), writer({"P_03": 9})
    overwritten = []

    def overwrite(now: float, times: int) -> None:
        if (
            autopilot.params["P_03"][0] == 9
            and len(overwritten) < times
            and core.progress.phase == "reading back"
        ):
            overwritten.append(now)
            autopilot.params["P_03"] = (4, INT32)

    run(core, autopilot, LossyLink(delay_s=0.05), each=lambda now: overwrite(now, 1))
    assert (
        len(overwritten) == 1
        and core.result["P_03"].outcome == "written"
        and autopilot.params["P_03"][0] == 9
    )
    autopilot, core = vehicle(), writer({"P_03": 9})
    overwritten.clear()
    run(core, autopilot, LossyLink(delay_s=0.05), each=lambda now: overwrite(now, 99))
    assert core.result["P_03"][:4] == ("refused", 9, 3, 4)
