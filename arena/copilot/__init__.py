"""The copilot: a process that checks every vehicle against rules and commands it to hold, land or terminate.

Rules are for example the fence and the separation of vehicles. The copilot must not withdraw a command, act
on missing data, command a vehicle on the ground, or override a human pilot. It receives poses from motion
capture, so they do not depend on the autopilots. It sends its commands, which are changes of the flight mode,
through the router and also on each autopilot's panic link.
"""
