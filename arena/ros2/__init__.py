"""Bridge between an arena and ROS 2: poses, telemetry and setpoints on ROS 2 topics.

It needs no installation of ROS 2.

`dds` is the only module that uses DDS. `incoming` decides which messages from ROS 2 may reach a vehicle.
"""
