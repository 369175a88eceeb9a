"""Comparison of captured motion with the autopilot's inertial sensors, to check a rigid body. Pure.

The results are the identity, the axes and the delay of the body.

The autopilot's own estimate is made from the captured poses, so it cannot show that they are wrong. Its accelerometer
and gyroscope do not depend on them. This package contains no sockets and no clocks.
"""
