"""Fork server: imports arena's packages once, and forks the Python processes of a starting arena.

Importing numpy, pymavlink and arena's packages takes longer than all other work of a process before it is ready. The fork server
imports them once. It runs only while a simulated arena starts, and it must not start threads, because it forks.
"""
