"""Physics steps of one sensor period for vehicles in free flight.

Rotors and bodies are computed in turn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from arena.kernels.arrays import Array
    from arena.kernels.free_flight import FreeFlight
    from arena.kernels.rotor_dynamics import RotorDynamics


class FlightPeriod:
    """Physics steps of V vehicles without pybullet, used while all of them are in free flight.

    rotors, bodies: kernels of rotors and bodies
    """

    def __init__(self, rotors: RotorDynamics, bodies: FreeFlight) -> None:
        self.rotors, self.bodies = rotors, bodies

    def set_motors(self, motors: Array) -> None:
        """Set the motor commands of the next steps, limited to 0..1; NaN counts as 0 [-] (V, R)."""
        to = self.rotors.motors
        for i in range(len(to)):
            for k in range(self.rotors.rotors):
                command = motors[i, k]
                to[i, k] = min(command, 1.0) if command > 0.0 else 0.0

    def step(self, count: int) -> None:
        """Make `count` physics steps with the motor commands in `rotors.motors`."""
        rotors, bodies = self.rotors, self.bodies
        for _ in range(count):
            for i in range(len(bodies.height)):
                rotors.height[i] = bodies.height[i]
                for k in range(3):
                    rotors.air_b[i, k] = bodies.air_b[i, k]
            rotors.step()
            for i in range(len(bodies.height)):
                for k in range(3):
                    bodies.force_b[i, k], bodies.torque_b[i, k] = rotors.force[i, k], rotors.torque[i, k]
            bodies.step()
            bodies.finish()
