"""Emulated relative sensors: position and velocity of neighbours, distance and direction of beacons.

They are computed from motion capture or from the estimates of the autopilots, for simulated and real vehicles alike.
"""
