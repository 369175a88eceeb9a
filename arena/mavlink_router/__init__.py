"""The MAVLink router: each vehicle's clients receive that vehicle, ground stations receive all. One process for an arena.

It reads frame headers and targets, and a few fields for the supervisor and the terminal. It must not decode, change or create
messages, except its own ground-station heartbeat.
"""
