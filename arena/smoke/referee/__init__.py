"""The referee of a smoke flight: receives observations, returns actions, and decides pass or fail.

Pure: without sockets, files and clocks.
"""
