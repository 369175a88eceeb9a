"""Motor commands of the built-in autopilots: controllers and control allocation in one call."""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels.arrays import floats

if TYPE_CHECKING:
    from arena.kernels.cascade import CascadeLaw
    from arena.kernels.control_allocation import ControlAllocation
    from arena.kernels.strapdown import Strapdown


class MotorOutputs:
    """Controllers and control allocation of V vehicles with at most R rotors each.

    state: estimated state.  cascade, allocation: controllers and control allocation
    up_from: input: time from which the motors follow the controllers [s], infinite before (V,)
    idle: input: motor commands before this time 0..1 [-] (V, R)
    thrust: output: collective thrust 0..1, zero before this time (V,)
    motors: output: motor commands 0..1 (V, R)
    """

    def __init__(
        self, state: Strapdown, cascade: CascadeLaw, allocation: ControlAllocation, rotors: int
    ) -> None:
        self.state, self.cascade, self.allocation = state, cascade, allocation
        v, self.rotors = len(allocation.thrust), rotors
        self.up_from, self.thrust = floats(v, fill=float("inf")), floats(v)
        self.idle, self.motors = floats(v, rotors), floats(v, rotors)

    def step(self, now: float, with_position: bool) -> None:
        """Compute the motor commands of all vehicles.

        now: time [s]
        with_position: run the position controller, too
        """
        self.read_estimates(with_position)
        cascade, allocation = self.cascade, self.allocation
        cascade.step(with_position)
        for i in range(len(self.thrust)):
            up = now >= self.up_from[i]
            self.thrust[i] = cascade.selected_thrust[i] if up else 0.0
            allocation.thrust[i] = self.thrust[i]
            for k in range(3):
                allocation.torque[i, k] = cascade.rate.torque[i, k] if up else 0.0
        allocation.step()
        for i in range(len(self.thrust)):
            up = now >= self.up_from[i]
            for k in range(3):
                cascade.rate.saturated[i, k] = allocation.saturated[i, k]
            for k in range(self.rotors):
                self.motors[i, k] = allocation.motors[i, k] if up else self.idle[i, k]

    def read_estimates(self, with_position: bool) -> None:
        """Copy the estimator's outputs (attitude, body rates, position) to the inputs of the controllers.

        with_position: also to those of the position controller
        """
        state, cascade = self.state, self.cascade
        for i in range(len(self.thrust)):
            for k in range(3):
                cascade.rate.omega_b[i, k] = state.omega_b[i, k]
                for n in range(3):
                    cascade.attitude.r_nb[i, k, n] = state.r_nb[i, k, n]
            for k in range(4):
                cascade.attitude.q_nb[i, k] = state.q_nb[i, k]
            if with_position:
                self._read_position(i)

    def _read_position(self, i: int) -> None:
        """Copy the estimates of vehicle i to the inputs of the position controller."""
        state, position = self.state, self.cascade.position
        for k in range(3):
            position.p_n[i, k], position.v_n[i, k] = state.p_n[i, k], state.v_n[i, k]
        for k in range(4):
            position.q_nb[i, k] = state.q_nb[i, k]
