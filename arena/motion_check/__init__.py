"""Comparison of captured motion with the autopilot's inertial sensors: axes, identity and delay of a rigid body. Pure.

The autopilot's own estimate is made from the captured poses, so it cannot show that they are wrong. Its accelerometer
and gyroscope do not depend on them. This package contains no sockets and no clocks.
"""
