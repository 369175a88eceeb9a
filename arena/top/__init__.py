"""Terminal view of a running arena: `arena top`. It sends no command to a vehicle or a process.

`frame` converts a snapshot of the live feed to tables, and `screen` draws them on the terminal and reads keys.
"""
