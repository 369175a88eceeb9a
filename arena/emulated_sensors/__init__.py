"""Emulated relative sensors: positions and velocities of neighbours, distances and directions of beacons.

They are computed from motion capture or from the estimates of the autopilots, for simulated and real vehicles alike.
"""
