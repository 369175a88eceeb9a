"""Simulated arena in one process: world, built-in autopilots, motion capture, pose forwarders, router and recorder.

They exchange messages in memory. Sockets remain for user programs, tools, ground stations and `arena land-all`.
"""
