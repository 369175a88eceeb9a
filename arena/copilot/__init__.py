"""The copilot: a process that watches every vehicle against the room and against the others, and orders hold, land or terminate.

It must not give anything back, act on what it does not know, command a vehicle on the ground, or fight a human pilot. Poses are
the motion capture's, past the autopilots; orders are the autopilots' own modes, sent through the router and straight to them.
"""
