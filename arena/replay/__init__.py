"""Replay: sends the recorded messages of a flight again, at their recorded times.

`script` says what was recorded, `playback` which message is sent at which time. Both are pure. `shell` has the sockets and the
clock. A replay commands nothing, and opens loopback sockets only.
"""
