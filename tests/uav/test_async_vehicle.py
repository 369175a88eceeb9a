"""`AsyncUAV` and `Swarm` on the wall clock, with fake autopilots; the event loop in simulated time."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from fake_autopilot import TELEMETRY, FakeAutopilot
from pymavlink.dialects.v20 import common as mavlink
from served import let_pass, until

from arena.clock import SimClock
from arena.clock_server import ClockServer
from arena.errors import InputError, NotConfirmedError, OffboardLostError, RunError, VehicleError
from arena.uav import UAV, AsyncUAV, Swarm, run, vehicle_control
from arena.uav.simulated_loop import LoopClock, SimulatedLoop, running_clock

from .conftest import Address, free_address, make_uav, sending_to

HANDS = ["--ns", "uav1", "--id", "1"]


@pytest.fixture
def flyer(uav: UAV) -> AsyncUAV:
    return AsyncUAV(uav)


def test_methods_are_those_of_the_blocking_class():
    blocking = {
        name
        for name in vars(UAV)
        if name.startswith(("set_", "start_", "arm", "disarm", "auto", "follow", "wait", "hold"))
    }
    assert blocking <= set(vars(AsyncUAV))


def test_flight_sends_what_the_blocking_flight_sends(autopilot, flyer):
    async def main() -> None:
        async with flyer:
            await flyer.start_offboard_mission()
            before = len(autopilot.setpoints)
            for _ in range(5):
                await flyer.set_vel_yaw([0, 0, -1], 0.0, 50)
            until(lambda: len(autopilot.setpoints) >= before + 5)
            autopilot.land_s = 0.1
            await flyer.auto_land()

    run(main(), HANDS)
    assert (autopilot.mode, autopilot.armed) == ("AUTO.LAND", False)
    asked = [c.command for c in autopilot.orders]
    assert asked == [
        mavlink.MAV_CMD_DO_SET_MODE,
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        mavlink.MAV_CMD_DO_SET_MODE,
    ]


def test_second_call_of_a_busy_vehicle_raises(autopilot, flyer):
    async def main() -> None:
        await flyer.start_offboard_mission()
        long = asyncio.ensure_future(flyer.set_pos_yaw(flyer.ekf.pos, 0.0, 60.0))
        await asyncio.sleep(0)
        with pytest.raises(VehicleError, match="set_vel_yaw was called while set_pos_yaw is running"):
            await flyer.set_vel_yaw([0, 0, 0], 0.0, 50)
        long.cancel()

    run(main(), HANDS)


def test_cancelled_method_sends_nothing_more(autopilot, flyer):
    async def main() -> None:
        await flyer.start_offboard_mission()
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(flyer.set_pos_yaw(flyer.ekf.pos, 0.0, 60.0), 0.2)

    run(main(), HANDS)
    let_pass(autopilot, 3)
    sent = len(autopilot.setpoints)
    let_pass(autopilot, 25)
    assert len(autopilot.setpoints) == sent


def test_loss_of_control_raises_in_the_coroutine(autopilot, flyer):
    async def main() -> None:
        await flyer.start_offboard_mission()
        autopilot.mode = "POSCTL"
        await flyer.set_pos_yaw(flyer.ekf.pos, 0.0, 30.0)

    with pytest.raises(OffboardLostError, match="left OFFBOARD"):
        run(main(), HANDS)


def test_loss_of_control_does_not_block_the_event_loop(autopilot, flyer, monkeypatch, tmp_path):
    """Other vehicles of the program get no setpoints while the loop is blocked."""

    class Time:
        monotonic = staticmethod(time.monotonic)

    async def main() -> None:
        await flyer.start_offboard_mission()
        flyer._uav.control._run = tmp_path  # an arena that records who took the vehicle
        monkeypatch.setattr(vehicle_control, "time", Time)  # without `sleep`
        autopilot.mode = "POSCTL"
        await flyer.set_pos_yaw(flyer.ekf.pos, 0.0, 30.0)

    with pytest.raises(OffboardLostError, match="left OFFBOARD"):
        run(main(), HANDS)


# -- Swarm --------------------------------------------------------------------------------------------------------------------


class Pair:
    """Two vehicles on fake autopilots, opened by a coroutine."""

    def __init__(self, addresses: list[Address], autopilots: list[FakeAutopilot]) -> None:
        self.addresses, self.autopilots = addresses, autopilots

    def swarm(self) -> Swarm:
        uavs = [make_uav(a, ns=f"uav{i}", system_id=i) for i, a in enumerate(self.addresses, 1)]
        return Swarm([AsyncUAV(uav) for uav in uavs])

    def fly(self, part) -> None:
        async def main() -> None:
            async with self.swarm() as swarm:
                await swarm.fly(part)

        run(main(), HANDS)


@pytest.fixture
def pair() -> Iterator[Pair]:
    addresses = [free_address(), free_address()]
    autopilots = [FakeAutopilot(system=i, telemetry=tuple(TELEMETRY), land_s=0.1) for i in (1, 2)]
    with ExitStack() as stack:
        for address, autopilot in zip(addresses, autopilots, strict=True):
            stack.enter_context(sending_to(address, autopilot))
        yield Pair(addresses, autopilots)


def test_barrier_returns_for_all_at_the_same_time(pair):
    starts, returned = [], []

    async def part(uav: AsyncUAV, swarm: Swarm) -> None:
        await uav.start_offboard_mission()
        if uav.info.drone_ns == "uav2":
            await uav.set_pos_yaw(uav.ekf.pos, 0.0, 0.6)
        starts.append(await swarm.barrier(uav, "up"))
        returned.append(swarm.now())
        await uav.auto_land()

    pair.fly(part)
    assert starts[0] == starts[1] and min(returned) >= starts[0]
    assert [a.armed for a in pair.autopilots] == [False, False]


def test_vehicle_that_waits_at_a_barrier_sends_setpoints(pair):
    async def part(uav: AsyncUAV, swarm: Swarm) -> None:
        await uav.start_offboard_mission()
        if uav.info.drone_ns == "uav2":
            await uav.set_pos_yaw(uav.ekf.pos, 0.0, 1.5)
        await swarm.barrier(uav, "up")
        await uav.auto_land()

    pair.fly(part)
    first = pair.autopilots[0]
    assert (np.diff(first.setpoint_ticks) * first.period_s).max() < 1.0


def test_missing_vehicle_ends_the_barrier_by_its_deadline_and_all_land(pair):
    async def part(uav: AsyncUAV, swarm: Swarm) -> None:
        await uav.start_offboard_mission()
        await swarm.barrier(uav, "started")
        if uav.info.drone_ns == "uav2":
            await uav.set_pos_yaw(uav.ekf.pos, 0.0, 600.0)
        await swarm.barrier(uav, "up", timeout=0.5)

    with pytest.raises(NotConfirmedError, match=r"uav1: barrier 'up' timed out after 0.5 s: missing uav2"):
        pair.fly(part)
    assert [(a.mode, a.armed) for a in pair.autopilots] == [("AUTO.LAND", False)] * 2


def test_barrier_does_not_wait_for_a_vehicle_whose_part_has_ended(pair):
    async def part(uav: AsyncUAV, swarm: Swarm) -> None:
        if uav.info.drone_ns == "uav1":
            await uav.start_offboard_mission()
            await swarm.barrier(uav, "up", timeout=600.0)

    with pytest.raises(NotConfirmedError, match="missing uav2"):
        pair.fly(part)
    assert pair.autopilots[0].mode == "AUTO.LAND"


def test_exception_of_one_vehicle_lands_all(pair):
    async def part(uav: AsyncUAV, swarm: Swarm) -> None:
        await uav.start_offboard_mission()
        await swarm.barrier(uav, "up")
        if uav.info.drone_ns == "uav2":
            raise ValueError("no such place")
        await uav.set_pos_yaw(uav.ekf.pos, 0.0, 600.0)

    with pytest.raises(ValueError, match="no such place"):
        pair.fly(part)
    assert [(a.mode, a.armed) for a in pair.autopilots] == [("AUTO.LAND", False)] * 2


def test_vehicle_that_a_pilot_flies_gets_no_command_when_all_land(pair):
    async def part(uav: AsyncUAV, swarm: Swarm) -> None:
        await uav.start_offboard_mission()
        await swarm.barrier(uav, "up")
        if uav.info.drone_ns == "uav2":
            pair.autopilots[1].mode = "POSCTL"  # the pilot takes the vehicle
        await uav.set_pos_yaw(uav.ekf.pos, 0.0, 600.0)

    with pytest.raises(OffboardLostError, match="uav2"):
        pair.fly(part)
    assert (pair.autopilots[0].mode, pair.autopilots[0].armed) == ("AUTO.LAND", False)
    assert (pair.autopilots[1].mode, pair.autopilots[1].armed) == ("POSCTL", True)


def test_vehicle_lands_while_the_part_of_another_vehicle_cleans_up(pair):
    landed = []

    async def part(uav: AsyncUAV, swarm: Swarm) -> None:
        await uav.start_offboard_mission()
        await swarm.barrier(uav, "up")
        if uav.info.drone_ns == "uav2":
            raise ValueError("no such place")
        try:
            await uav.set_pos_yaw(uav.ekf.pos, 0.0, 600.0)
        finally:
            end = time.monotonic() + 30.0
            while pair.autopilots[1].mode != "AUTO.LAND" and time.monotonic() < end:
                await asyncio.sleep(0.02)
            landed.append(pair.autopilots[1].mode)

    with pytest.raises(ValueError, match="no such place"):
        pair.fly(part)
    assert landed == ["AUTO.LAND"]
    assert [(a.mode, a.armed) for a in pair.autopilots] == [("AUTO.LAND", False)] * 2


# -- simulated time -----------------------------------------------------------------------------------------------------------


class World(threading.Thread):
    """A world that only advances the simulation clock in lockstep, as fast as its clients allow."""

    def __init__(self, path: Path) -> None:
        super().__init__(daemon=True)
        self._server, self._over, self._t = ClockServer(path, lockstep=True), threading.Event(), 0.0
        self._server.tick(0.0)

    def run(self) -> None:
        while not self._over.is_set():
            self._server.poll()
            if self._server.joined and self._server.may_advance(self._t, time.monotonic()):
                self._t += 0.01
                self._server.tick(self._t)
        self._server.close()

    def end(self) -> None:
        self._over.set()
        self.join(30)


@pytest.fixture
def world(tmp_path: Path) -> Iterator[Path]:
    made = World(tmp_path / "clock")
    made.start()
    yield tmp_path / "clock"
    made.end()


def test_sleeps_and_timeouts_use_simulated_time(world):
    async def sleeper(seconds: float) -> float:
        await asyncio.sleep(seconds)
        return asyncio.get_running_loop().time()

    async def main() -> list[float]:
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(asyncio.sleep(1e6), 100.0)
        return await asyncio.gather(sleeper(50.0), sleeper(20.0))

    began = time.monotonic()
    times = run(main(), [*HANDS, "--clock", str(world)])
    assert times == pytest.approx([150.0, 120.0], abs=0.05)
    assert time.monotonic() - began < 100.0


def test_order_of_tasks_in_simulated_time_is_that_of_their_times(world):
    order: list[tuple[int, int]] = []

    async def task(number: int, period: float) -> None:
        for step in range(20):
            await asyncio.sleep(period)
            order.append((number, step))

    async def main() -> None:
        await asyncio.gather(task(1, 0.3), task(2, 0.5))

    run(main(), [*HANDS, "--clock", str(world)])
    due = [(round(0.3 * (s + 1) if n == 1 else 0.5 * (s + 1), 6), n, s) for n, s in order]
    assert [d[0] for d in due] == sorted(d[0] for d in due)


def test_end_of_the_world_ends_the_program(tmp_path):
    made = World(tmp_path / "clock")
    made.start()

    async def main() -> None:
        await asyncio.sleep(0.1)
        made._over.set()
        await asyncio.sleep(1e6)

    with pytest.raises(RunError, match="has ended"):
        run(main(), [*HANDS, "--clock", str(tmp_path / "clock")])


def test_chores_run_in_simulated_time_and_blocking_sleep_raises(world):
    calls: list[float] = []

    async def main() -> None:
        clock = running_clock(str(world), "uav1")
        assert isinstance(clock, LoopClock) and clock.lockstep
        clock.do_while_asleep(lambda: calls.append(clock.now()), 0.1, lambda at: True)
        await asyncio.sleep(1.0)
        with pytest.raises(RunError, match="blocking sleep"):
            clock.sleep_until(clock.now() + 1.0)

    run(main(), [*HANDS, "--clock", str(world)])
    assert 8 <= len(calls) <= 10


def test_vehicle_with_simulation_clock_on_another_loop_raises():
    async def main() -> None:
        with pytest.raises(InputError, match=r"arena\.uav\.run"):
            running_clock("/tmp/clock", "uav1")

    asyncio.run(main())


def test_loop_closes_its_client_of_the_clock(world):
    client = SimClock(world, "uav1")
    SimulatedLoop(client).close()
    assert client.fileno() == -1
