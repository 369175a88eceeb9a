"""Flight along a trajectory file (`arena fly VEHICLE FILE`), with take-off and landing.

The vehicle first flies to the start of the trajectory.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable

import numpy as np

from arena.constants import GRAVITY_M_S2
from arena.errors import (
    EXIT_FAILED,
    EXIT_INTERRUPTED,
    EXIT_OK,
    InputError,
    NotConfirmedError,
    RunError,
    VehicleError,
)
from arena.fly.connect import open_uav
from arena.fly.feasibility import FlightLimits, collisions, limits_of, problems_of
from arena.fly.parameters import read_parameters
from arena.fly.running_vehicle import RunningVehicle, lock_pilot
from arena.geometry import Array, yaw_from_quat
from arena.portable_math import norm
from arena.trajectories import StraightLine, Trajectory
from arena.uav import UAV

SPEED_M_S = 1.0
"""Greatest speed on the way to the start."""
_PARAMETERS = ("MPC_XY_VEL_MAX", "MPC_Z_VEL_MAX_UP", "MPC_Z_VEL_MAX_DN", "MPC_TILTMAX_AIR")
_ARRIVED_M, _ARRIVE_S, _REST_S = 0.15, 10.0, 1.0
Say = Callable[[str], None]


def check_flight(vehicle: RunningVehicle, trajectory: Trajectory) -> FlightLimits:
    """Check a trajectory against the limits of the vehicle and its room, and return these limits.

    Raises InputError with every reason not to fly the trajectory.
    """
    values = read_parameters(vehicle, _PARAMETERS)
    speed, up, down, tilt = (values[name] for name in _PARAMETERS)
    accel = round(GRAVITY_M_S2 * math.tan(math.radians(min(tilt, 80.0))), 2)
    limits = limits_of(vehicle.room, vehicle.settings, (speed, up, down, accel))
    if problems := problems_of(trajectory, limits):
        raise InputError("the trajectory was not flown:\n" + "\n".join(f"  {text}" for text in problems))
    return limits


def check_authority(vehicle: RunningVehicle) -> None:
    """Check that the vehicle is disarmed and that nobody else has control.

    Raises RunError otherwise.
    """
    facts = vehicle.facts()
    if blocked := facts.get("blocked"):
        raise RunError(f"{vehicle.name}: {blocked}: run `arena release {vehicle.name}` first")
    if facts.get("control"):
        raise RunError(f"{vehicle.name}: {facts['control']} has control. Land the vehicle, then try again")
    if facts.get("armed"):
        raise RunError(
            f"{vehicle.name}: the vehicle is armed. A trajectory starts with a disarmed vehicle on the ground"
        )


def fly_file(vehicle: RunningVehicle, trajectory: Trajectory, say: Say) -> int:
    """Fly a vehicle along a trajectory and land it. Return the exit code.

    Ctrl-C lands the vehicle.

    say: function that prints a line
    Raises InputError if the trajectory cannot be flown, and RunError if another sender commands the vehicle.
    """
    check_authority(vehicle)
    limits = check_flight(vehicle, trajectory)
    with contextlib.closing(lock_pilot(vehicle)), open_uav(vehicle, lockstep=True) as uav:
        try:
            _fly(uav, trajectory, limits, say)
            say("landing")
            uav.auto_land()
        except (VehicleError, RunError) as error:
            say(f"TRAJECTORY NOT COMPLETED: {error}")
            return land_after_error(uav, vehicle, say)
        except KeyboardInterrupt:
            say("interrupted by Ctrl-C: landing the vehicle")
            return land_after_error(uav, vehicle, say, EXIT_INTERRUPTED)
        say(f"{vehicle.name}: landed and disarmed")
    return EXIT_OK


def _fly(uav: UAV, trajectory: Trajectory, limits: FlightLimits, say: Say) -> None:
    start = trajectory.at(0.0)
    uav.start_offboard_mission()
    here, yaw = np.asarray(uav.ekf.pos, float), float(yaw_from_quat(uav.ekf.att_q))
    above = np.array([here[0], here[1], start.pos[2]])
    check_way(np.array([above, start.pos]), limits)
    height_m = -start.pos[2]
    say(f"taking off to a height of {height_m:.2f} m")
    uav.follow(StraightLine(here, above, yaw=(yaw, yaw), speed=SPEED_M_S, shortest_s=4.0))
    _arrive(uav, above, yaw)
    north, east, _ = start.pos
    say(f"flying to the start of the trajectory: north {north:.2f} m, east {east:.2f} m")
    uav.follow(StraightLine(above, start.pos, yaw=(yaw, start.yaw), speed=SPEED_M_S))
    _arrive(uav, start.pos, start.yaw)
    say(f"flying the trajectory ({trajectory.duration_s:.1f} s)")
    uav.follow(trajectory)
    end = trajectory.at(trajectory.duration_s)
    uav.set_pos_yaw(end.pos, end.yaw, _REST_S)


def check_way(p: Array, limits: FlightLimits) -> None:
    """Check that no obstacle is too near to the straight, level path to the start of the trajectory.

    Raises VehicleError.

    p: both ends of the way [m] [NED] (2, 3). The climb before the way is not checked.
    """
    if problems := list(collisions(None, p, limits)):
        too_near_to_obstacle = problems[0]
        raise VehicleError(
            f"the straight way to the start of the trajectory is {too_near_to_obstacle}. Place the vehicle below the start"
        )


def _arrive(uav: UAV, pos: object, yaw: float) -> None:
    """Send a position setpoint repeatedly until the vehicle has arrived at the position.

    Raises NotConfirmedError after 10 s.
    """
    end = uav.clock.now() + _ARRIVE_S
    wanted = np.asarray(pos, float)
    while norm(np.asarray(uav.ekf.pos, float) - wanted) > _ARRIVED_M:
        if uav.clock.now() > end:
            raise NotConfirmedError(
                f"{uav.info.drone_ns}: not at the position {wanted.round(2).tolist()} m [NED] after {_ARRIVE_S:g} s"
            )
        uav.set_pos_yaw(wanted, yaw, 0.1)


def land_after_error(uav: UAV, vehicle: RunningVehicle, say: Say, code: int = EXIT_FAILED) -> int:
    """Land the vehicle after an error if this program still flies it. Return the exit code.

    A vehicle that another sender has taken gets no command, also if it is a program that flies in OFFBOARD.
    """
    try:
        if uav.control.flies(vehicle.settings.offboard_loss_s):
            uav.auto_land()
            say("the vehicle has landed and is disarmed")
        elif uav.info.is_armed:
            mode = uav.info.flight_mode
            say(f"the vehicle is still armed, in {mode}. This command does not control it any more")
    except (VehicleError, RunError) as error:
        say(f"LANDING NOT CONFIRMED: {error}. Use `arena land-all`")
        return EXIT_FAILED
    return code
