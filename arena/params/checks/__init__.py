"""Checks and comparison of parameter values."""
