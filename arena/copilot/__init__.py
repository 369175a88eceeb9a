"""The copilot: a process that checks every vehicle against rules, such as fence and separation, and commands
hold, land or terminate.

The copilot must not withdraw a command, act on missing data, command a vehicle on the ground, or override a
human pilot. It receives poses from motion capture, so they do not depend on the autopilots. It sends its
commands, which are changes of the flight mode, through the router and also on each autopilot's panic link.
"""
