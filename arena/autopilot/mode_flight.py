"""Setpoints of each armed vehicle in its present flight mode.

The commanders decide about the modes.
"""

from __future__ import annotations

import math

from arena.autopilot.commander_inputs import CommanderInputs
from arena.autopilot.control.controllers import PositionControl
from arena.autopilot.control.flight_tasks import FlightTask, stop_motors
from arena.autopilot.control.manual_tasks import ManualState, ManualTask
from arena.autopilot.control.setpoints import Level, Setpoints
from arena.autopilot.estimation.estimator import Estimator
from arena.autopilot.flight_modes import MANUAL_MODES, Mode
from arena.autopilot.navigation.auto_modes import AutoModes
from arena.autopilot.param_table import Params
from arena.autopilot.vehicle import Vehicle
from arena.wire.sticks import CENTRED


class ModeFlight:
    """Execution of the flight modes of V vehicles: computes the setpoints that the controllers follow.

    position: position controller, whose last velocity setpoints continue when a pilot takes over
    dt: time between two calls of `fly` [s]
    auto: flies missions, returns and reposition targets
    """

    def __init__(
        self,
        params: Params,
        est: Estimator,
        sp: Setpoints,
        position: PositionControl,
        vehicles: int,
        dt: float,
    ) -> None:
        self.params, self.est, self.sp, self.dt, self._position = params, est, sp, dt, position
        self.auto = AutoModes(params, est, vehicles, dt)
        self._tasks = [FlightTask(i) for i in range(vehicles)]
        self._manual = [ManualTask(i) for i in range(vehicles)]

    def stop(self, v: Vehicle) -> None:
        """Remove the setpoint of a disarmed vehicle."""
        self.sp.clear(v.row)
        self._tasks[v.row].mode = self._manual[v.row].mode = None
        self.auto.leave(v, armed=False)

    def fly(self, v: Vehicle, s: CommanderInputs, *, newly_armed: bool) -> None:
        """Compute and store the setpoint of an armed vehicle for its present mode."""
        c, i, task = v.commander, v.row, self._tasks[v.row]
        if newly_armed:
            v.set_home_to_current_position()
            task.mode = self._manual[i].mode = None
        manual = c.mode in MANUAL_MODES
        if not manual:
            self._manual[i].mode = None
        if self.auto.is_flying(v):
            task.mode = None
            requested = self.auto.fly(v, s, self.sp)
            if requested is not None:
                c.request_mode(requested, s, v.commander_params)
            return
        self.auto.leave(v, armed=True)
        if manual:
            task.mode = None
            self._fly_by_hand(v, s)
        elif c.mode is Mode.OFFBOARD:
            task.mode = None
            v.offboard.copy(i)
        elif c.mode is Mode.TERMINATE:
            stop_motors(self.sp, i)
        else:
            self._fly_task(v, s, task)

    def _fly_task(self, v: Vehicle, s: CommanderInputs, task: FlightTask) -> None:
        c = v.commander
        if task.mode is not c.mode:
            task.enter(c.mode, self.est, v.yaw(), self.params, landed=s.landed, takeoff_d=v.takeoff_target_d)
        ground_d = v.home_n[2] if v.home_n else 0.0
        task.fly(self.sp, self.est, self.params, landed=not s.flying, ground_d=ground_d)
        if c.mode is Mode.TAKEOFF and task.reached:
            c.request_mode(Mode.HOLD, s, v.commander_params)

    def _fly_by_hand(self, v: Vehicle, s: CommanderInputs) -> None:
        """Compute and store the setpoint of a vehicle in a manual mode, from its stick positions.

        Lost sticks count as released until the failsafe acts.
        """
        i, task, mode = v.row, self._manual[v.row], v.commander.mode
        p, velocity = self.est.p_n[i].tolist(), self.est.v_n[i].tolist()
        last = self._position.v_sp_n[i].tolist() if self.sp.level[i] == Level.POSITION else [math.nan] * 3
        state = ManualState(
            yaw=v.yaw(),
            p_n=(p[0], p[1], p[2]),
            v_n=(velocity[0], velocity[1], velocity[2]),
            v_sp_n=(last[0], last[1], last[2]),
            height_m=v.home_n[2] - p[2] if v.home_n else math.nan,
            flying=s.flying,
            landed=s.landed,
            spooled_up_s=s.now - v.commander.armed_since - float(self.params["COM_SPOOLUP_TIME"][i]),
        )
        if task.mode is not mode:
            task.enter(mode, state)
        task.fly(s.manual.sticks or CENTRED, state, self.sp, self.params, self.dt)
