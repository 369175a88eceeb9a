"""Smoke flights: the scenario language, the referee that judges, and the flying of scenarios.

Imports run one way: language <- referee <- flying. Language and referee are pure: no sockets, processes or
    clocks.
"""
