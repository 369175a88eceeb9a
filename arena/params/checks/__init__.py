"""Checks that find problems in PX4 parameter values, and comparison of two sets of values."""
