"""The Lissajous figures of the experiment. Figures 1 and 2 are in the thesis's published programs, figure 3 is our own."""

from math import pi

import numpy as np

from arena.trajectories import Reference

DURATION_S = 60.0
FREQ_HZ = 50
CURVES = {  # per axis, north, east, down: amplitude [m], angular frequency [rad/s], phase [rad]
    "1": ((2.6, 1.6, 0.6), (1.10, 1.65, 0.35), (0.0, pi / 2, pi / 2)),
    "1b": (
        (2.6, 1.6, 0.6),
        (1.10, 1.65, 0.55),
        (0.0, pi / 2, pi / 2),
    ),  # the vertical motion of the flight on positions
    "2": ((2.6, 1.6, -0.6), (0.3 * pi, 0.2 * pi, 2 * pi / 15), (2 * pi / 3, pi / 2, pi / 2 + pi / 9)),
    "3": ((2.6, 1.3, 0.4), (0.80, 1.60, 0.80), (pi / 2, 0.0, pi / 2)),
}
CENTRE = np.array([0.0, 0.0, -1.2])


def at(name, t):
    """Return the reference of a figure at time t [s]: position, velocity, acceleration [NED]."""
    amplitude, rate, phase = np.array(CURVES[name])
    angle = rate * t + phase
    return Reference(
        pos=CENTRE + amplitude * np.sin(angle),
        vel=amplitude * rate * np.cos(angle),
        acc=-amplitude * rate**2 * np.sin(angle),
        yaw=0.0,
    )
