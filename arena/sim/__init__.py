"""The simulated world: rigid bodies, rotors, wind, sensors, battery, verdicts. Its step loop is `python -m
arena.sim`.

The core (`World`) has no socket, clock or file; pybullet is imported in `bodies` alone.
"""
