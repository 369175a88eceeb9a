"""Fused arena: one process with world, built-in autopilots, motion capture, forwarders, router and recorder.

They exchange messages in memory. Sockets remain for user programs, tools, ground stations and `arena land-all`.
"""
