"""Estimation of the built-in autopilot: the Kalman filter and the land detector."""
