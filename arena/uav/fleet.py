"""`Fleet`: all vehicles of a group that a single program flies."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from types import TracebackType
from typing import Protocol, Self, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike
from pymavlink.dialects.v20 import common as mavlink

from arena.clock import LockstepClock
from arena.errors import ArenaError, SetpointError, StaleDataError, VehicleError
from arena.geometry import Array
from arena.uav.data_groups import Ekf, Info
from arena.uav.group_clock import GroupThreads
from arena.uav.setpoints import Encoder, period_s

_CHORES_EVERY_S = 0.1
_FOREVER_S = 1e9


class FleetVehicle(Protocol):
    """Interface of the vehicles in a `Fleet`. `UAV` implements it."""

    ekf: Ekf
    info: Info

    @property
    def encoder(self) -> Encoder: ...

    def start_offboard_mission(self) -> None: ...

    def auto_land(self) -> None: ...

    def send(self, message: mavlink.MAVLink_message) -> None: ...

    def hold_until(self, done: Callable[[], bool], timeout: ArrayLike) -> bool: ...

    def chores(self) -> None: ...

    def close(self) -> None: ...


V = TypeVar("V", bound=FleetVehicle)


class Fleet(Sequence[V]):
    """List of all `UAV` objects that one program flies, in the order of the YAML.

    clock: clock of the program. Use it instead of the module `time`.
    lost: vehicle -> VehicleError that one of its methods has raised. No more setpoints are sent to a lost vehicle, so its
    autopilot's offboard failsafe acts; the other vehicles fly on. At the end of the `with` block an error with all lost vehicles is raised.
    """

    def __init__(self, uavs: Sequence[V], threads: GroupThreads) -> None:
        self._uavs, self._threads = tuple(uavs), threads
        self.names = tuple(uav.info.drone_ns for uav in uavs)
        self.lost: dict[str, VehicleError] = {}
        self.clock = threads.clock("fleet")
        self._due = -np.inf
        if isinstance(self.clock, LockstepClock) and self.clock.lockstep:
            self.clock.do_while_asleep(self._chores, _CHORES_EVERY_S, lambda at: True)

    def __len__(self) -> int:
        return len(self._uavs)

    @overload
    def __getitem__(self, index: int) -> V: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[V]: ...

    def __getitem__(self, index: int | slice) -> V | Sequence[V]:
        return self._uavs[index]

    @property
    def pos(self) -> Array:
        """Estimated positions [m] [NED] (V, 3).

        NaN for lost vehicles and for vehicles without a fresh estimate.
        """
        found = np.full((len(self), 3), np.nan)
        for row, uav in self._flown():
            try:
                found[row] = uav.ekf.pos
            except StaleDataError:
                continue
        return found

    def start_offboard_mission(self) -> None:
        """Wait until each vehicle is ready, enter OFFBOARD and arm; for all vehicles at the same time."""
        self.each(lambda uav: uav.start_offboard_mission())

    def auto_land(self) -> None:
        """Land all vehicles at their positions. Return when all of them are on the ground and disarmed."""
        self.each(lambda uav: uav.auto_land())

    def each(self, action: Callable[[V], object]) -> None:
        """Call the function `action` for all vehicles at the same time. Return when all calls have ended.

        A vehicle in OFFBOARD whose call has ended holds its position until all calls have ended. If a call raises
        a VehicleError, its vehicle is recorded in `lost`, and the other calls continue. Other errors are raised after all calls have ended.
        """
        flown = list(self._flown())
        ended, errors = set[str](), list[BaseException]()

        def call(uav: V) -> None:
            try:
                self._guarded(uav, lambda: action(uav))
            except BaseException as error:  # raised below, on the thread of the program
                errors.append(error)
            ended.add(uav.info.drone_ns)
            try:
                self._guarded(uav, lambda: uav.hold_until(lambda: len(ended) == len(flown), _FOREVER_S))
            except ArenaError as error:
                errors.append(error)

        self._threads.run_all([partial(call, uav) for _, uav in flown])
        if errors:
            raise errors[0]
        self._check_any_left()

    def set_pos_yaw(self, pos: ArrayLike, yaw: ArrayLike, freq: ArrayLike) -> None:
        """Send a position setpoint to each vehicle, then wait until the next setpoint is due.

        A loop with one such call runs at the rate `freq`.

        pos: [m] [NED] (V, 3). yaw: [rad], one for all or (V,). freq: [Hz]. Rows of lost vehicles are not used.
        """
        p, y = self._rows(pos, "pos"), self._yaws(yaw)
        self._send(lambda row, uav, now: uav.encoder.pos_yaw(p[row], y[row], now), freq)

    def set_vel_yaw(self, vel: ArrayLike, yaw: ArrayLike, freq: ArrayLike) -> None:
        """Send a velocity setpoint to each vehicle, then wait until the next setpoint is due.

        A loop with one such call runs at the rate `freq`.

        vel: [m/s] [NED] (V, 3). yaw: [rad], one for all or (V,). freq: [Hz].
        """
        v, y = self._rows(vel, "vel"), self._yaws(yaw)
        self._send(lambda row, uav, now: uav.encoder.vel_yaw(v[row], y[row], now), freq)

    def set_pos_vel_yaw(
        self, pos: ArrayLike, vel: ArrayLike, yaw: ArrayLike, freq: ArrayLike, *, acc: ArrayLike | None = None
    ) -> None:
        """Send a trajectory setpoint to each vehicle, then wait until the next setpoint is due.

        A loop with one such call runs at the rate `freq`.

        pos: [m] [NED] (V, 3). vel: [m/s] [NED] (V, 3). yaw: [rad], one for all or (V,). freq: [Hz].
        acc: [m/s2] [NED] (V, 3), without gravity; None sends no acceleration.
        """
        p, v, y = self._rows(pos, "pos"), self._rows(vel, "vel"), self._yaws(yaw)
        a = None if acc is None else self._rows(acc, "acc")

        def message(row: int, uav: V, now: float) -> mavlink.MAVLink_message:
            return uav.encoder.pos_vel_yaw(p[row], v[row], y[row], now, acc=None if a is None else a[row])

        self._send(message, freq)

    def close(self) -> None:
        """Close all connections without sending a command.

        Vehicles in the air then enter their offboard loss failsafe.
        """
        for uav in self._uavs:
            uav.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        if error is None and self.lost:
            raise VehicleError(self._words())

    def _send(self, message: Callable[[int, V, float], mavlink.MAVLink_message], freq: ArrayLike) -> None:
        period = period_s(freq)
        now = self.clock.now()
        for row, uav in self._flown():
            self._guarded(uav, partial(uav.send, message(row, uav, now)))
        self._check_any_left()
        now = self.clock.now()
        self._due = self._due + period if 0.0 <= now - self._due < period else now + period
        self.clock.sleep_until(self._due)

    def _flown(self) -> Iterator[tuple[int, V]]:
        """Yield (index in the fleet, vehicle) for each vehicle whose earlier calls have not failed (see `lost`)."""
        yield from ((row, uav) for row, uav in enumerate(self._uavs) if self.names[row] not in self.lost)

    def _guarded(self, uav: V, action: Callable[[], object]) -> None:
        """Call a function for one vehicle of the fleet. If it fails, the vehicle counts as lost.

        If the function raises a VehicleError, print the error and record the vehicle in `lost`.
        """
        name = uav.info.drone_ns
        if name in self.lost:
            return
        try:
            action()
        except SetpointError:
            raise
        except VehicleError as error:
            self.lost[name] = error
            print(
                f"{name}: the program has lost this vehicle and sends it no more setpoints: {error}",
                file=sys.stderr,
                flush=True,
            )

    def _check_any_left(self) -> None:
        if len(self.lost) == len(self):
            raise VehicleError(self._words())

    def _words(self) -> str:
        words = "; ".join(str(error) for error in list(self.lost.values())[:3])
        more = f"; and {len(self.lost) - 3} more" if len(self.lost) > 3 else ""
        return f"{len(self.lost)} of {len(self)} vehicles were lost: {words}{more}"

    def _rows(self, value: ArrayLike, what: str) -> Array:
        found = np.asarray(value, dtype=np.float64)
        if found.shape != (len(self), 3):
            raise SetpointError(
                f"{what}: got shape {found.shape}, expected ({len(self)}, 3), one row for each vehicle"
            )
        return found

    def _yaws(self, value: ArrayLike) -> Array:
        found = np.asarray(value, dtype=np.float64)
        if found.shape not in ((), (1,), (len(self),)):
            raise SetpointError(
                f"yaw: got shape {found.shape}, expected one number or ({len(self)},), one for each vehicle"
            )
        return np.broadcast_to(found, (len(self),))

    def _chores(self) -> None:
        for uav in self._uavs:
            uav.chores()
