"""Modules of the contract script, which compares the built-in autopilot with PX4.

They contain the vehicle under test, the cases, the comparison, and the list of accepted differences.
"""
