"""The MAVLink router, one process per arena. A vehicle's clients receive this vehicle; ground stations
receive all vehicles.

The router reads frame headers and target ids, and a few fields that the supervisor and the terminal show. It
must not decode, change or create messages, except its own heartbeat as a ground station.
"""
