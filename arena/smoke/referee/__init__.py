"""The referee of a smoke flight: receives observations, returns the actions to carry out, and decides whether the flight passed.

Pure: without sockets, files and clocks.
"""
