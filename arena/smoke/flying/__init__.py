"""Execution of scenarios: start the arena, observe it, and carry out actions on it."""
