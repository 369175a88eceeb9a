"""Function `arena.connect`: returns a vehicle of a running arena for a notebook, IPython or a shell."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from arena.clock import Clock, Rate, SimClock, WallClock
from arena.errors import ArenaError, InputError, RunError, VehicleError
from arena.fly.running_vehicle import RunningVehicle, find_vehicle
from arena.uav import UAV
from arena.uav.arguments import read_file

_POLL_S = 0.001
_OFFBOARD = "OFFBOARD"


class FollowedClock:
    """Clock that returns the simulation time to an interactive session, without ever pausing the simulation.

    After the end of the world all methods raise RunError: the time no longer advances, so old data would count as fresh.

    path: path of the simulation clock without suffix
    """

    def __init__(self, path: str) -> None:
        # It never requests a wake-up, so the world does not wait for it. No program has a name with a dot.
        self._client = SimClock(path, "arena.connect")

    @property
    def has_ended(self) -> bool:
        """True if the world has ended."""
        return self._client.ended()

    def now(self) -> float:
        """Return the simulation time [s]."""
        if self.has_ended:
            raise RunError("the simulated world has ended")
        return self._client.now()

    def sleep_until(self, t: float) -> float:
        """Sleep until the simulation time t [s]. Return the time after the sleep [s].

        Ctrl-C interrupts the sleep.
        """
        while (now := self.now()) < t:
            time.sleep(max(_POLL_S, min(0.02, 0.5 * (t - now))))
        return now

    def rate(self, hz: float) -> Rate:
        """Return a timer for a loop with a fixed rate [Hz]."""
        return Rate(self, hz)


class Session:
    """Session of a person who flies a vehicle from a notebook or a shell.

    The attribute `uav` flies the vehicle; `end` lands it.

    vehicle: the vehicle. lockstep: in a simulation that is not in real time, the world waits while this session does not sleep
    Raises InputError if another program of this vehicle has its port.
    """

    def __init__(self, vehicle: RunningVehicle, *, lockstep: bool = False) -> None:
        self.vehicle = vehicle
        self.uav = open_uav(vehicle, lockstep=lockstep)

    def end(self, say: Callable[[str], None] = print) -> None:
        """Land the vehicle if this session flies it, and close the connection.

        A vehicle that is disarmed, or that a pilot, `land-all`, a ground station, a node of ROS 2 or an SDK flies, is not commanded.
        For an armed one, a line says who flies it. A line also says if the state of the vehicle is not known.
        A vehicle that cannot be landed enters its offboard failsafe, because no setpoints are sent any more.
        """
        try:
            if self._flies():
                say(f"{self.vehicle.name}: landing")
                self.uav.auto_land()
                say(f"{self.vehicle.name}: landed and disarmed")
            elif text := self._flown_by_others():
                say(text)
        except ArenaError as error:
            if self._world_has_ended():
                say(f"{self.vehicle.name}: the simulated world has ended")
            else:
                say(f"{self.vehicle.name}: LANDING NOT CONFIRMED: {error}. Use `arena land-all`")
        finally:
            self.uav.close()

    def _flies(self) -> bool:
        try:
            return self._has_control()
        except VehicleError:
            return False
        except RunError:
            if self._world_has_ended():
                raise
        # The thread that receives raises an error once. It must not keep the vehicle from its landing.
        return self._has_control()

    def _has_control(self) -> bool:
        return self.uav.info.is_armed and self.uav.control.flies(self.vehicle.settings.offboard_loss_s)

    def _world_has_ended(self) -> bool:
        clock = self.uav.clock
        return isinstance(clock, FollowedClock) and clock.has_ended

    def _flown_by_others(self) -> str:
        """Return a warning that the vehicle is still armed: its mode, and who has control; "" if disarmed.

        If the vehicle's state is not known, the warning says why.
        """
        try:
            if not self.uav.info.is_armed:
                return ""
            mode = self.uav.info.flight_mode
        except VehicleError as error:
            return f"{self.vehicle.name}: NOT LANDED by this shell: state not known ({error}). Use `arena land-all`"
        return f"{self.vehicle.name}: NOT LANDED by this shell: armed in {mode}, {self._holder(mode)}"

    def _holder(self, mode: str) -> str:
        """Return who controls a vehicle that this session does not fly, as text. mode: flight mode of the vehicle."""
        try:
            control = self.vehicle.facts().get("control")
        except RunError:  # the supervisor has ended
            return "and the arena does not reply"
        if mode == _OFFBOARD and control in (None, "", "program"):
            return "and another program has control"
        return f"and {control or 'nobody'} has control"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()


def connect(
    name: str | None = None, run: str | Path | None = None, *, lockstep: bool = False, real: bool = False
) -> UAV:
    """Connect to a vehicle of a running arena and return it as `UAV`.

    name: name of the vehicle; None for the only vehicle. run: run folder, if several arenas have a vehicle with this name.
    lockstep: in a simulation that is faster than real time, the world waits while this session flies the vehicle and does not sleep.
        Without it, the world never waits, and setpoints may come too late for the autopilot.
    real: allow a real vehicle. A notebook that was written for a simulation must not fly one by mistake.
    The vehicle must have no program of its own that runs: only one process can receive at the program's port. Clocks are as in a
    program: simulation time for simulated vehicles, wall time for real vehicles.
    `close` sends no command: a vehicle in the air then enters its offboard failsafe, and lands.
    After the end of a simulated world the methods and values of the vehicle raise RunError, unless `lockstep` is set.
    Raises RunError if no arena runs, and InputError if the name fits no vehicle, the vehicle is real without `real`, or the port is
    in use.
    """
    vehicle = find_vehicle(name, None if run is None else Path(run))
    if vehicle.is_real and not real:
        raise InputError(
            f"{vehicle.name} is a real vehicle: use `arena.connect({vehicle.name!r}, real=True)`"
        )
    return open_uav(vehicle, lockstep=lockstep)


def open_uav(vehicle: RunningVehicle, *, lockstep: bool) -> UAV:
    """Connect to a vehicle in the same way as its user program.

    Raises InputError if another program uses the program's port.
    """
    arguments = read_file(str(vehicle.program_file), partial(_clock, lockstep=lockstep))
    try:
        return UAV(**{**arguments, "heartbeat": None})
    except InputError as error:
        raise InputError(
            f"{vehicle.name}: {error} A vehicle with a running program cannot be flown from here: end the program, or write no "
            "`program` in the YAML"
        ) from error


def _clock(stem: str | None, name: str, *, lockstep: bool) -> Clock:
    if stem is None:
        return WallClock()
    return SimClock(stem, name) if lockstep else FollowedClock(stem)
