"""The simulated world: bodies, actuators, wind, sensors, batteries, crash detection. `python -m arena.sim` runs it.

The core (`World`) has no socket, clock or file; pybullet is imported in `bodies` alone.
"""
