"""The copilot: a process that monitors every vehicle by rules, such as fence and separation, and commands hold, land or terminate.

It must not take an order back, act on missing data, command a vehicle on the ground, or override a human pilot. Poses come from
motion capture, independent of the autopilots. Orders are flight modes, sent through the router and on the panic link.
"""
