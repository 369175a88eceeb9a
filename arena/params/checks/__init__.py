"""Check and comparison of parameter values."""
