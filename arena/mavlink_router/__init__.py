"""The MAVLink router: each vehicle's clients hear that vehicle, ground stations hear all. One process for an arena.

It reads frame headers and targets, and peeks into two messages for the facts that the supervisor waits for. It must not
decode, change or invent messages, but for its own ground-station heartbeat.
"""
