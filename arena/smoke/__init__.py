"""Smoke flights: automated test flights that are described by scenario files.

Three packages: `language` reads scenario files, `referee` decides whether a flight passed, `flying` runs the arena.
`referee` imports `language`, and `flying` imports both; never the other way round. `language` and `referee` are pure:
they use no sockets, processes or clocks.
"""
