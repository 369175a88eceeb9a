"""How reading, writing and rebooting end: armed, vanished, not heard, interrupted, done."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.params.transfer.transfer import Rebooter, Transfer

from .simulated_vehicle import ME, Air, Vehicle, holds, others, outcomes, reader, run, writer

# -- endings --------------------------------------------------------------------------------------------------------------------


def test_an_armed_vehicle_is_never_written_to() -> None:
    vehicle, core = Vehicle(armed=True), writer(others())
    run(core, vehicle, Air())
    assert (
        core.ending == "armed"
        and vehicle.told == []
        and not {"written", "same"} & set(outcomes(core).values())
    )


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
            return (
                [self.pack(mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0))]
                if int(now * 100) % 10 == 0
                else []
            )

    vehicle, core = Shy(), writer(others())
    with pytest.raises(AssertionError, match="not done within 20"):
        run(core, vehicle, Air(), limit_s=20.0)
    assert core.progress.phase == "writing" and vehicle.told == []


def test_one_whose_heartbeats_are_lost_for_8_s_is_not_written_to_meanwhile_and_not_believed_to_have_gone() -> (
    None
):
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
    assert core.ending == "done" and air.counted["up"] - 60 < 1.3 * 3 * 60, (
        "no more than a third is asked for in vain"
    )


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


@pytest.mark.parametrize(
    "make", [lambda: writer(others()), reader, lambda: Rebooter(system=1, component=ME, now=0.0)]
)
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


# -- rebooting ------------------------------------------------------------------------------------------------------------------


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
