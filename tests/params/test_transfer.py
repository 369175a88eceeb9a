"""Tests of how transfers end: done, armed, no connection, connection lost, interrupted."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.params.transfer.transfer import Rebooter, Transfer

from .simulated_vehicle import ME, LossyLink, Vehicle, holds, new_values, outcomes, reader, run, writer

# -- endings --------------------------------------------------------------------------------------------------------------------


def test_armed_vehicle_is_not_written_to() -> None:
    vehicle, core = Vehicle(armed=True), writer(new_values())
    run(core, vehicle, LossyLink())
    assert (
        core.ending == "armed"
        and vehicle.written_names == []
        and not {"written", "same"} & set(outcomes(core).values())
    )


@pytest.mark.parametrize("at", [1, 17, 59])
def test_writing_ends_at_the_first_armed_heartbeat(at: int) -> None:
    vehicle, core = Vehicle(), writer(new_values())
    seen: list[int] = []

    def arm(now: float) -> None:
        if len(vehicle.written_names) >= at and not vehicle.armed:
            vehicle.armed, vehicle._next_heartbeat = True, now
        if core.done:
            seen.append(len(vehicle.written_names))

    run(core, vehicle, LossyLink(delay_s=0.02), each=arm)
    written = len(vehicle.written_names)
    assert core.ending == "armed" and core.due(1000.0) == [] and written < 60 + at
    assert set(core.written) <= set(vehicle.written_names)
    assert all(r.outcome in ("written", "unanswered", "differs") for r in core.result.values())
    assert "acknowledged, but not read back" in {r.why for r in core.result.values()} or not core.written


def test_nothing_is_written_before_a_disarmed_heartbeat() -> None:
    class WithoutHeartbeat(Vehicle):
        """A vehicle that sends its attitude and no heartbeat."""

        def step(self, now: float) -> list[bytes]:
            return (
                [self.pack(mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0))]
                if int(now * 100) % 10 == 0
                else []
            )

    vehicle, core = WithoutHeartbeat(), writer(new_values())
    with pytest.raises(AssertionError, match="not done within 20"):
        run(core, vehicle, LossyLink(), limit_s=20.0)
    assert core.progress.phase == "writing" and vehicle.written_names == []


def test_writing_pauses_while_heartbeats_are_missing() -> None:
    class WithGap(Vehicle):
        def step(self, now: float) -> list[bytes]:
            found = super().step(now)
            return [] if 1.0 < now < 9.0 else found

    vehicle, core = WithGap(), writer(new_values())
    written: dict[int, int] = {}
    run(
        core,
        vehicle,
        LossyLink(delay_s=0.5),
        each=lambda now: written.__setitem__(int(now), len(vehicle.written_names)),
    )
    assert core.ending == "done" and holds(vehicle, new_values())
    assert written[6] == written[8] < 60, "the last heartbeat is older than 3 s"


def test_slow_link_gets_few_repeated_requests() -> None:
    link, core = LossyLink(delay_s=1.2), writer(new_values())
    run(core, Vehicle(), link)
    assert core.ending == "done" and link.counted["up"] - 60 < 1.3 * 3 * 60, (
        "less than a third of the requests are repeated"
    )


def test_lost_connection_ends_the_transfer_after_3_s() -> None:
    vehicle, core = Vehicle(), writer(new_values())
    gone: list[float] = []

    def disconnect(now: float) -> None:
        if len(vehicle.written_names) > 20 and vehicle.alive:
            vehicle.alive = False
            gone.append(now)

    took = run(core, vehicle, LossyLink(delay_s=0.02), each=disconnect)
    assert core.ending == "connection lost" and 2.9 < took - gone[0] < 3.5
    assert {"written", "unanswered"} == set(outcomes(core).values())
    assert len(core.before) == 60 and 10 <= len(core.written) <= 21


@pytest.mark.parametrize(
    "make", [lambda: writer(new_values()), reader, lambda: Rebooter(system=1, component=ME, now=0.0)]
)
def test_missing_vehicle_ends_the_transfer_after_10_s(make: Any) -> None:
    core: Transfer = make()
    assert 9.9 < run(core, Vehicle(alive=False), LossyLink()) < 11.0
    assert core.ending == "no connection"


def test_stopped_transfer_sends_nothing_more() -> None:
    vehicle, core = Vehicle(), writer(new_values())
    run(
        core,
        vehicle,
        LossyLink(delay_s=0.02),
        each=lambda _: core.stop() if len(vehicle.written_names) > 20 else None,
    )
    assert core.ending == "interrupted" and core.due(1e3) == [] and 0 < len(core.written) < 60


def test_progress_grows_to_its_total() -> None:
    core, seen = writer(new_values() | {"NO_SUCH": 1.0}), []
    run(core, Vehicle(), LossyLink(delay_s=0.02), each=lambda _: seen.append(core.progress.n))
    assert seen == sorted(seen) and core.progress.n == core.progress.of == 3 * 61


def test_nothing_wanted_is_done_at_once() -> None:
    core = writer({})
    run(core, Vehicle(), LossyLink())
    assert core.ending == "done" and core.result == {}


# -- rebooting ------------------------------------------------------------------------------------------------------------------


def test_reboot_is_sent_once_and_acknowledged() -> None:
    vehicle, core = Vehicle(), Rebooter(system=1, component=ME, now=0.0)
    run(core, vehicle, LossyLink(delay_s=0.02))
    assert core.ending == "done" and core.refusal == "" and vehicle.rebooted == 1


def test_reboot_with_a_lost_acknowledgement_is_not_repeated() -> None:
    class Gone(Vehicle):
        def _answer(self, m: Any) -> list[bytes]:
            super()._answer(m)
            self.alive = False
            return []

    vehicle, core = Gone(), Rebooter(system=1, component=ME, now=0.0)
    run(core, vehicle, LossyLink(delay_s=0.02))
    assert core.ending == "done" and vehicle.rebooted == 1


def test_armed_vehicle_is_not_rebooted() -> None:
    vehicle, core = Vehicle(armed=True), Rebooter(system=1, component=ME, now=0.0)
    run(core, vehicle, LossyLink())
    assert core.ending == "armed" and vehicle.rebooted == 0
