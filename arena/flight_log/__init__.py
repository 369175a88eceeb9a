"""Logs of flights: the class `Flight` (one vehicle's log in memory), log columns, and one module per file format.

Files are read after a flight. No module here opens a socket or sends anything.
"""
