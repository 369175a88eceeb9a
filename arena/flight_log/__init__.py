"""Logs of flights in memory and in files: the class `Flight`, the columns of a log, and one module per file format.

Files are read after a flight. No module here opens a socket or sends anything.
"""
