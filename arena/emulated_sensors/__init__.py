"""Emulated relative sensors of vehicles: positions and velocities of neighbours, and directions of beacons.

They are computed from motion capture or from the estimates of the autopilots, for simulated and real vehicles alike.
"""
