"""Position and velocity from distances to beacons: an extended Kalman filter. The acceleration is known from the accelerometer.

State: position [m] and velocity [m/s], NED. Prediction: p += v dt + a dt^2 / 2, v += a dt. Measurement: |beacon - p|.
A. Gelb (editor), "Applied Optimal Estimation", MIT Press 1974, section 6.1.
"""

import numpy as np

ACC_NOISE = 0.5  # error of the acceleration, mostly from the attitude [m/s2]
OUTLIER = 16.0  # a distance whose squared error is larger than this multiple of its variance is not used


class RangeFilter:
    """Estimator. pos, vel: first guess [m], [m/s] [NED] (3,).  pos_error_m: its error, rms per axis."""

    def __init__(self, pos, pos_error_m):
        self.x = np.concatenate([np.asarray(pos, float), np.zeros(3)])
        self.cov = np.diag([pos_error_m**2] * 3 + [0.1**2] * 3)

    @property
    def pos(self):
        return self.x[:3]

    @property
    def vel(self):
        return self.x[3:]

    def predict(self, acc, step_s):
        """Predict the state. acc: acceleration without gravity [m/s2] [NED] (3,).  step_s: time since the last prediction [s]."""
        move = np.block([[np.eye(3), step_s * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
        force = np.vstack([0.5 * step_s**2 * np.eye(3), step_s * np.eye(3)])
        self.x = move @ self.x + force @ acc
        self.cov = move @ self.cov @ move.T + force @ force.T * ACC_NOISE**2

    def correct(self, beacon, distance, noise_m):
        """Correct the state with a measured distance. beacon: its position [m] [NED] (3,).  distance, noise_m: [m]."""
        away = self.pos - beacon
        expected = float(np.linalg.norm(away))
        row = np.concatenate([away / expected, np.zeros(3)])
        error, variance = distance - expected, float(row @ self.cov @ row) + noise_m**2
        if error**2 > OUTLIER * variance:
            return
        gain = self.cov @ row / variance
        self.x = self.x + gain * error
        self.cov = self.cov - np.outer(gain, row @ self.cov)
