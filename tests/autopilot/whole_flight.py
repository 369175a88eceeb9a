"""A short flight that prints the SHA-256 of its motor commands, true states and telemetry: `python whole_flight.py`."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from flight import Flight


def take_off(flight: Flight, p_n: Any) -> None:
    """Arm vehicle 0 in OFFBOARD, and send this position setpoint [m] [NED] for 0.5 s more."""

    def stream(f: Flight) -> None:
        f.setpoint(0, p_n)

    flight.until(lambda f: f.pilots.vehicles[0].ready_to_arm, 20, stream)
    flight.run(0.5, stream)
    assert flight.offboard(0) == 0
    flight.setpoint(0, p_n)
    assert flight.arm(0) == 0
    flight.run(0.5, stream)


def main() -> None:
    flight, sent = Flight(2, wind_m_s=[1.0, 0.5, 0.0], gusts_m_s=0.5), hashlib.sha256()
    transmit = flight.pilots.transmit

    def noted() -> Any:
        for vehicle, link, data in (out := list(transmit())):
            sent.update(f"{vehicle} {link} ".encode() + bytes(data))
        return out

    flight.pilots.transmit = noted
    take_off(flight, (0.3, 0.0, -1.0))
    for _ in range(200):
        flight.run(0.02, lambda f: f.setpoint(0, (0.3, 0.0, -1.0), 0.5))
        truth = flight.world.truth()
        for part in (flight.motors, truth.p_n, truth.v_n, truth.q_nb, truth.omega_b):
            sent.update(np.ascontiguousarray(part).tobytes())
    print(f"{-flight.position(0)[2]:.2f} m, {sent.hexdigest()}")


if __name__ == "__main__":
    main()
