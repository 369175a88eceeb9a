"""Tests of how transfers end: done, armed, no connection, connection lost, interrupted."""

from __future__ import annotations

from typing import Any

import pytest
from fake_autopilot import INT32, REBOOT, REQUEST
from rebooting_autopilot import rebooting
from served import LossyLink

from arena.params.transfer.after_reboot import AfterRebootReader
from arena.params.transfer.reader import ParamReader
from arena.params.transfer.transfer import Rebooter, Transfer
from arena.params.transfer.uid_check import UidCheck
from arena.wire.mavlink_minimal import AUTOPILOT_VERSION, SYSTEM_TIME

from .simulated_transfer import (
    ME,
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

# -- endings --------------------------------------------------------------------------------------------------------------------


def test_armed_vehicle_is_not_written_to() -> None:
    autopilot, core = vehicle(armed=True), writer(new_values())
    run(core, autopilot, LossyLink())
    assert (
        core.ending == "armed"
        and autopilot.written_names == []
        and not {"written", "same"} & set(outcomes(core).values())
    )


@pytest.mark.parametrize("at", [1, 17, 59])
def test_writing_ends_at_the_first_armed_heartbeat(at: int) -> None:
    autopilot, core = vehicle(), writer(new_values())
    seen: list[int] = []

    def arm(now: float) -> None:
        if len(autopilot.written_names) >= at and not autopilot.armed:
            autopilot.armed, autopilot.next_telemetry_s = True, now
        if core.done:
            seen.append(len(autopilot.written_names))

    run(core, autopilot, LossyLink(delay_s=0.02), each=arm)
    written = len(autopilot.written_names)
    assert core.ending == "armed" and core.due(1000.0) == [] and written < 60 + at
    assert set(core.written) <= set(autopilot.written_names)
    assert all(r.outcome in ("written", "unanswered", "differs") for r in core.result.values())
    assert "acknowledged, but not read back" in {r.why for r in core.result.values()} or not core.written


def test_nothing_is_written_before_a_disarmed_heartbeat() -> None:
    autopilot, core = vehicle(telemetry=("ATTITUDE",), period_s=0.1), writer(new_values())
    with pytest.raises(AssertionError, match="not done within 20"):
        run(core, autopilot, LossyLink(), limit_s=20.0)
    assert core.progress.phase == "writing" and autopilot.written_names == []


def test_writing_pauses_while_heartbeats_are_missing() -> None:
    autopilot, core = vehicle(), writer(new_values())
    written: dict[int, int] = {}

    def mute(now: float) -> None:
        autopilot.mute = 0.5 < now < 9.0
        written[int(now)] = len(autopilot.written_names)

    run(core, autopilot, LossyLink(delay_s=0.5), each=mute)
    assert core.ending == "done" and holds(autopilot, new_values())
    assert written[6] == written[8] < 60, "the last heartbeat is older than 3 s"


def test_slow_link_gets_few_repeated_requests() -> None:
    link, core = LossyLink(delay_s=1.2), writer(new_values())
    run(core, vehicle(), link)
    assert core.ending == "done" and link.counted["up"] - 60 < 1.3 * 3 * 60, (
        "less than a third of the requests are repeated"
    )


def test_lost_connection_ends_the_transfer_after_3_s() -> None:
    autopilot, core = vehicle(), writer(new_values())
    gone: list[float] = []

    def disconnect(now: float) -> None:
        if len(autopilot.written_names) > 20 and autopilot.alive:
            autopilot.alive = False
            gone.append(now)

    took = run(core, autopilot, LossyLink(delay_s=0.02), each=disconnect)
    assert core.ending == "connection lost" and 2.9 < took - gone[0] < 3.5
    assert {"written", "unanswered"} == set(outcomes(core).values())
    assert len(core.before) == 60 and 10 <= len(core.written) <= len(autopilot.written_names)


@pytest.mark.parametrize(
    "make", [lambda: writer(new_values()), reader, lambda: Rebooter(system=1, component=ME, now=0.0)]
)
def test_missing_vehicle_ends_the_transfer_after_10_s(make: Any) -> None:
    core: Transfer = make()
    assert 9.9 < run(core, vehicle(alive=False), LossyLink()) < 11.0
    assert core.ending == "no connection"


def test_stopped_transfer_sends_nothing_more() -> None:
    autopilot, core = vehicle(), writer(new_values())
    run(
        core,
        autopilot,
        LossyLink(delay_s=0.02),
        each=lambda _: core.stop() if len(autopilot.written_names) > 20 else None,
    )
    assert core.ending == "interrupted" and core.due(1e3) == [] and 0 < len(core.written) < 60


def test_progress_grows_to_its_total() -> None:
    core, seen = writer(new_values() | {"NO_SUCH": 1.0}), []
    run(core, vehicle(), LossyLink(delay_s=0.02), each=lambda _: seen.append(core.progress.n))
    assert seen == sorted(seen) and core.progress.n == core.progress.of == 3 * 61


def test_nothing_wanted_is_done_at_once() -> None:
    core = writer({})
    run(core, vehicle(), LossyLink())
    assert core.ending == "done" and core.result == {}


# -- rebooting ------------------------------------------------------------------------------------------------------------------


def test_reboot_is_sent_once_and_acknowledged() -> None:
    autopilot, core = vehicle(), Rebooter(system=1, component=ME, now=0.0)
    run(core, autopilot, LossyLink(delay_s=0.02))
    assert core.ending == "done" and core.refusal == "" and autopilot.rebooted == 1


def test_reboot_with_a_lost_acknowledgement_is_not_repeated() -> None:
    autopilot, core = vehicle(ignore={REBOOT}), Rebooter(system=1, component=ME, now=0.0)

    def restart(_: float) -> None:
        autopilot.alive = not autopilot.commands

    run(core, autopilot, LossyLink(delay_s=0.02), each=restart)
    assert core.ending == "done" and autopilot.rebooted == 1


def test_armed_vehicle_is_not_rebooted() -> None:
    autopilot, core = vehicle(armed=True), Rebooter(system=1, component=ME, now=0.0)
    run(core, autopilot, LossyLink())
    assert core.ending == "armed" and autopilot.rebooted == 0


# -- after a reboot -------------------------------------------------------------------------------------------------------------


def after_reboot(*names: str, **more: Any) -> AfterRebootReader:
    return AfterRebootReader(system=1, component=ME, now=0.0, names=names, requested_at=0.5, **more)


@pytest.mark.parametrize("seed", range(3))
def test_values_from_before_the_reboot_are_not_used(seed: int) -> None:
    autopilot = rebooting(params=sixty_params(), reset={"P_03": (99, INT32)}, goes_at=1.5)
    core, other = after_reboot("P_03", "P_05"), reader(["P_03"])

    def request(now: float) -> None:
        if now < 1.4:  # another program reads the value before the reboot
            for frame in other.due(now):
                link.send("up", frame, now)

    link = lossy_link(seed)
    run(core, autopilot, link, each=request)
    assert core.ending == "done" and core.values["P_03"].value == 99 and core.values["P_05"].value == 5
    assert not core.missing


def test_only_a_push_requests_the_boot_time() -> None:
    pushed, pulled = vehicle(), vehicle()
    run(writer({"P_03": 9}, uid=UidCheck("")), pushed, LossyLink())
    run(ParamReader(system=1, component=ME, now=0.0, names=["P_03"], uid=UidCheck("")), pulled, LossyLink())
    requested = [{c.param1 for c in v.commands} for v in (pushed, pulled)]
    assert requested == [{AUTOPILOT_VERSION, SYSTEM_TIME}, {AUTOPILOT_VERSION}]


def test_vehicle_that_answers_without_a_reboot_is_not_read() -> None:
    autopilot, core = rebooting(params=sixty_params()), after_reboot("P_03")
    assert 5.0 <= run(core, autopilot, LossyLink()) < 6.0
    assert core.ending == "not rebooted" and not core.values


def test_vehicle_that_no_longer_reports_its_boot_time_is_not_read() -> None:
    core = after_reboot("P_03", reports_boot_time=True)
    assert 5.0 <= run(core, vehicle(), LossyLink()) < 6.0
    assert core.ending == "no connection" and not core.values


def test_boot_time_is_requested_together_with_the_uid() -> None:
    autopilot, core = rebooting(params=sixty_params(), age_s=0.0), after_reboot("P_03", uid=UidCheck(""))
    autopilot.ignore = {REQUEST}  # so the uid is requested again and again
    run(core, autopilot, LossyLink())
    assert [c.param1 for c in autopilot.commands][:2] == [AUTOPILOT_VERSION, SYSTEM_TIME]


def test_rebooted_vehicle_without_system_time_is_read() -> None:
    core = after_reboot("P_03")
    assert 3.0 <= run(core, vehicle(), LossyLink()) < 4.0
    assert core.ending == "done" and core.values["P_03"].value == 3
