"""Reading and writing one vehicle's parameters, over the air of simulated time."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from arena.params import messages
from arena.params.asking import Asking, Pace
from arena.params.reading import Reader
from arena.params.transfer import Rebooter, Transfer
from arena.params.writing import Writer
from arena.wire.codec import Codec
from arena.wire.mavframe import cut

from .simulated import INT32, REAL32, Air, Vehicle, rough, run, sixty

SEEDS = range(20)
ME = 200


def writer(wanted: dict[str, float], **more: Any) -> Writer:
    return Writer(system=1, component=ME, now=0.0, wanted=wanted, **more)


def reader(names: list[str] | None = None) -> Reader:
    return Reader(system=1, component=ME, now=0.0, names=names)


def others() -> dict[str, float]:
    """Other values for all sixty."""
    return {name: (value * 3 + 1 if kind == INT32 else value + 0.1) for name, (value, kind) in sixty().items()}


def holds(vehicle: Vehicle, wanted: dict[str, float]) -> bool:
    return all(math.isclose(vehicle.params[name][0], value, rel_tol=1e-6) for name, value in wanted.items())


def outcomes(core: Writer) -> dict[str, str]:
    return {name: result.outcome for name, result in core.result.items()}


# -- over a rough wire ---------------------------------------------------------------------------------------------------------


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
    assert {name for name, outcome in outcomes(core).items() if outcome == "unknown"} == {"NO_SUCH", "NOR_THIS"}
    assert set(outcomes(core).values()) == {"written", "unknown"}


@pytest.mark.parametrize("seed", range(5))
def test_a_wire_that_loses_a_third_each_way_still_makes_no_name_unknown(seed: int) -> None:
    vehicle, core = Vehicle(), writer(others())
    run(core, vehicle, Air(seed=seed, loss=0.33, delay_s=0.1, late=0.1), limit_s=300)
    if core.ending == "done":
        assert set(outcomes(core).values()) == {"written"} and holds(vehicle, others())
    else:
        assert core.ending == "vanished" and "unknown" not in outcomes(core).values()


@pytest.mark.parametrize("seed", range(5))
def test_the_whole_list_is_read_with_what_was_lost_of_it(seed: int) -> None:
    vehicle, core = Vehicle(params={f"P_{i:03d}": (i, INT32) for i in range(300)}), reader()
    run(core, vehicle, rough(seed))
    assert core.ending == "done" and core.missing == {}
    assert {name: value.value for name, value in core.values.items()} == {f"P_{i:03d}": i for i in range(300)}
    assert core.progress.n == core.progress.of == 300


# -- what is sent --------------------------------------------------------------------------------------------------------------


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
    assert outcomes(core)["P_01"] == "same" and outcomes(core)["P_00"] == "differs" and outcomes(core)["NO_SUCH"] == "unknown"


@pytest.mark.parametrize("value", [3.5, 2.0**31, math.nan, math.inf])
def test_what_an_integer_cannot_be_is_refused_and_not_sent(value: float) -> None:
    vehicle, core = Vehicle(), writer({"P_01": value, "P_03": 7})
    run(core, vehicle, Air())
    assert core.result["P_01"].outcome == "refused" and core.result["P_01"].why.endswith("not sent")
    assert vehicle.told == ["P_03"]


def test_a_float_that_no_parameter_can_hold_is_refused() -> None:
    vehicle, core = Vehicle(), writer({"P_02": 1e39})
    run(core, vehicle, Air())
    assert core.result["P_02"].outcome == "refused" and "too large" in core.result["P_02"].why and vehicle.told == []


@pytest.mark.parametrize("name", ["", "SEVENTEEN_LETTERS", "P\0", "GRÖSSE", "_HASH_CHECK"])
def test_what_can_be_no_name_is_unknown_and_never_sent(name: str) -> None:
    vehicle, core = Vehicle(), writer({name: 1.0, "P_03": 7})
    run(core, vehicle, Air())
    assert core.result[name].outcome == "unknown" and core.result["P_03"].outcome == "written"
    asked = reader([name, "P_03"])
    run(asked, Vehicle(), Air())
    assert asked.missing == {name: "unknown"} and set(asked.values) == {"P_03"}


# -- what vehicles do ----------------------------------------------------------------------------------------------------------


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
    assert outcomes(core)["LATE"] == outcomes(core)["LATER"] == "written" and outcomes(core)["NEVER"] == "unknown"
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
            return [self.error(m.param_id, 2)] if m.get_type() == "PARAM_SET" and m.param_id == "P_03" else super()._answer(m)

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
        for data in (stranger.value("P_03"), camera.value("P_03"), stranger.step(now)[0] if int(now * 100) % 100 == 0 else b""):
            for frame in cut(data).frames:
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


def test_a_list_that_grows_while_it_is_read_is_read_anew() -> None:
    vehicle, core = Vehicle(), reader()

    def grow(now: float) -> None:
        if len(core.values) > 20:
            vehicle.params.setdefault("P_05A", (1, INT32))

    run(core, vehicle, Air(delay_s=0.02), each=grow)
    assert core.ending == "done" and set(core.values) == {*sixty(), "P_05A"}


def test_a_list_that_another_program_stops_is_asked_for_again() -> None:
    vehicle, core = Vehicle(per_turn=2), reader()
    stopped = []

    def stop(now: float) -> None:
        if len(core.values) > 5 and not stopped:
            stopped.append(now)
            vehicle._left = []

    run(core, vehicle, Air(delay_s=0.02), each=stop)
    assert stopped and core.ending == "done" and set(core.values) == set(sixty())


# -- endings -------------------------------------------------------------------------------------------------------------------


def test_an_armed_vehicle_is_never_written_to() -> None:
    vehicle, core = Vehicle(armed=True), writer(others())
    run(core, vehicle, Air())
    assert core.ending == "armed" and vehicle.told == [] and not {"written", "same"} & set(outcomes(core).values())


@pytest.mark.parametrize("at", [1, 17, 59])
def test_one_that_arms_meanwhile_is_left_alone_from_its_next_heartbeat(at: int) -> None:
    vehicle, core = Vehicle(), writer(others())
    seen: list[int] = []

    def arm(now: float) -> None:
        if len(vehicle.told) >= at and not vehicle.armed:
            vehicle.armed, vehicle._next_beat = True, now
        if core.done:
            seen.append(len(vehicle.told))

    run(core, vehicle, Air(delay_s=0.02), each=arm)
    told = len(vehicle.told)
    assert core.ending == "armed" and core.due(1000.0) == [] and told < 60 + at
    assert set(core.written) <= set(vehicle.told)
    assert all(r.outcome in ("written", "lost", "differs") for r in core.result.values())
    assert "acknowledged, but not read back" in {r.why for r in core.result.values()} or not core.written


def test_nothing_is_written_before_a_heartbeat_has_told_that_it_is_not_armed() -> None:
    class Shy(Vehicle):
        """Tells its attitude and no heartbeat."""

        def step(self, now: float) -> list[bytes]:
            return [self.pack(mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0))] if int(now * 100) % 10 == 0 else []

    vehicle, core = Shy(), writer(others())
    with pytest.raises(AssertionError, match="not done within 20"):
        run(core, vehicle, Air(), limit_s=20.0)
    assert core.progress.phase == "writing" and vehicle.told == []


def test_one_whose_heartbeats_are_lost_for_8_s_is_not_written_to_meanwhile_and_not_believed_to_have_gone() -> None:
    class Faint(Vehicle):
        def step(self, now: float) -> list[bytes]:
            found = super().step(now)
            return [] if 1.0 < now < 9.0 else found

    vehicle, core = Faint(), writer(others())
    told: dict[int, int] = {}
    run(core, vehicle, Air(delay_s=0.5), each=lambda now: told.__setitem__(int(now), len(vehicle.told)))
    assert core.ending == "done" and holds(vehicle, others())
    assert told[6] == told[8] < 60, "the last heartbeat is older than 3 s"


def test_a_slow_wire_is_not_crowded() -> None:
    air, core = Air(delay_s=1.2), writer(others())
    run(core, Vehicle(), air)
    assert core.ending == "done" and air.counted["up"] - 60 < 1.3 * 3 * 60, "no more than a third is asked for in vain"


def test_a_vehicle_that_vanishes_ends_it_after_3_s_with_what_is_known() -> None:
    vehicle, core = Vehicle(), writer(others())
    gone: list[float] = []

    def vanish(now: float) -> None:
        if len(vehicle.told) > 20 and vehicle.alive:
            vehicle.alive = False
            gone.append(now)

    took = run(core, vehicle, Air(delay_s=0.02), each=vanish)
    assert core.ending == "vanished" and 2.9 < took - gone[0] < 3.5
    assert {"written", "lost"} == set(outcomes(core).values())
    assert len(core.before) == 60 and 10 <= len(core.written) <= 21


@pytest.mark.parametrize("make", [lambda: writer(others()), reader, lambda: Rebooter(system=1, component=ME, now=0.0)])
def test_one_that_is_never_heard_ends_it(make: Any) -> None:
    core: Transfer = make()
    assert 9.9 < run(core, Vehicle(alive=False), Air()) < 11.0
    assert core.ending == "not heard"


def test_stopped_it_says_so_and_sends_nothing_more() -> None:
    vehicle, core = Vehicle(), writer(others())
    run(core, vehicle, Air(delay_s=0.02), each=lambda _: core.stop() if len(vehicle.told) > 20 else None)
    assert core.ending == "interrupted" and core.due(1e3) == [] and 0 < len(core.written) < 60


def test_progress_only_grows_and_ends_full() -> None:
    core, seen = writer(others() | {"NO_SUCH": 1.0}), []
    run(core, Vehicle(), Air(delay_s=0.02), each=lambda _: seen.append(core.progress.n))
    assert seen == sorted(seen) and core.progress.n == core.progress.of == 3 * 61


def test_with_nothing_wanted_it_is_done_at_once() -> None:
    core = writer({})
    run(core, Vehicle(), Air())
    assert core.ending == "done" and core.result == {}


# -- rebooting -----------------------------------------------------------------------------------------------------------------


def test_a_reboot_is_commanded_once_and_acknowledged() -> None:
    vehicle, core = Vehicle(), Rebooter(system=1, component=ME, now=0.0)
    run(core, vehicle, Air(delay_s=0.02))
    assert core.ending == "done" and core.refusal == "" and vehicle.rebooted == 1


def test_a_reboot_whose_acknowledgement_is_lost_is_seen_by_the_silence_and_not_repeated() -> None:
    class Gone(Vehicle):
        def _answer(self, m: Any) -> list[bytes]:
            super()._answer(m)
            self.alive = False
            return []

    vehicle, core = Gone(), Rebooter(system=1, component=ME, now=0.0)
    run(core, vehicle, Air(delay_s=0.02))
    assert core.ending == "done" and vehicle.rebooted == 1


def test_an_armed_vehicle_is_not_rebooted() -> None:
    vehicle, core = Vehicle(armed=True), Rebooter(system=1, component=ME, now=0.0)
    run(core, vehicle, Air())
    assert core.ending == "armed" and vehicle.rebooted == 0


# -- messages ------------------------------------------------------------------------------------------------------------------


@given(st.integers(-(2**31), 2**31 - 1))
@example(-5_000_001)
def test_every_integer_survives_the_float_it_travels_in(value: int) -> None:
    """Signalling NaNs among them, which a copy as a float would change."""
    number, payload = messages.set_value(1, "P", value, INT32)
    assert number == 23 and payload[:4] == struct.pack("<i", value)
    raw = struct.pack("<i", value) + struct.pack("<HH16sB", 10, 3, b"P", INT32)
    data = Codec(1, 1).frame(22, raw)
    assert messages.parse_value(data, cut(data).frames[0]) == ("P", value, INT32, 3, 10)


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_every_float_survives(value: float) -> None:
    data = Codec(1, 1).pack(mavlink.MAVLink_param_value_message(b"SIXTEEN_LETTERS_", value, REAL32, 10, 3))
    assert messages.parse_value(data, cut(data).frames[0]) == ("SIXTEEN_LETTERS_", value, REAL32, 3, 10)
    assert messages.fitted(value, REAL32) == value


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (messages.request_list(7), mavlink.MAVLink_param_request_list_message(7, 1)),
        (messages.request_read(7, "ABC"), mavlink.MAVLink_param_request_read_message(7, 1, b"ABC", -1)),
        (messages.request_read(7, 300), mavlink.MAVLink_param_request_read_message(7, 1, b"", 300)),
        (messages.set_value(7, "ABC", 0.25, REAL32), mavlink.MAVLink_param_set_message(7, 1, b"ABC", 0.25, REAL32)),
        (messages.reboot(7), mavlink.MAVLink_command_long_message(7, 1, 246, 0, 1, 0, 0, 0, 0, 0, 0)),
    ],
)
def test_our_frames_are_pymavlinks(message: messages.Message, expected: Any) -> None:
    assert Codec(252, ME).frame(*message) == Codec(252, ME).pack(expected)


# -- the judgement of silence --------------------------------------------------------------------------------------------------


def test_the_more_a_wire_loses_the_more_silences_it_takes() -> None:
    clean, lossy = Pace(), Pace()
    for _ in range(60):
        clean.learn(1, 0.1)
        lossy.learn(2, 0.1)
    assert clean.enough == 5 and 15 <= lossy.enough <= 25


def test_patience_follows_the_round_trip() -> None:
    pace = Pace()
    for _ in range(50):
        pace.learn(1, 1.5)
    assert 1.5 < pace.patience(1) < 2.0 < pace.patience(3)


def test_no_more_than_the_window_are_in_flight() -> None:
    asking = Asking(range(1, 100), Pace(), 0)
    assert asking.due(0.0) == list(range(1, 11)) and asking.due(0.1) == []
    asking.answer(4, 0.2)
    assert asking.due(0.2) == [11]
