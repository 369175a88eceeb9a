"""Smoke flights: scenarios, who judges them, who flies them. The judging half is pure: no sockets, no processes, no clocks."""
