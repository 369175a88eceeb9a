"""The MAVLink router, one process per arena.

It forwards the messages of a vehicle to the clients of this vehicle, and the messages of all vehicles to the ground
stations.

The router reads frame headers and target ids, and a few fields that the supervisor and the terminal show. It
must not decode, change or create messages, except its own heartbeat as a ground station.
"""
