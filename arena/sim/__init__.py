"""The simulated world: bodies, actuators, wind, sensors, batteries and crash detection.

`python -m arena.sim` runs it. The core (`World`) uses no socket, clock or file. Only `bodies` imports
pybullet.
"""
