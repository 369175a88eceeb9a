"""The link process of one flight controller. It connects the controller to the router and the pose forwarder,
and refuses to arm a real vehicle while a preflight check fails.
"""
