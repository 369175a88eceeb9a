"""Grouping of MAVLink frames that the router sends together as one datagram."""

from __future__ import annotations

from arena.wire.mavlink_frame import Frame

MAX_DATAGRAM_BYTES = 1472  # the largest UDP payload of one Ethernet frame
NO_TARGET = -1


def join_frames(frames: list[Frame], targets: list[int]) -> list[tuple[int, int, int, int]]:
    """Group adjacent frames with the same target, so that each group can be sent as one datagram.

    frames: all frames of a received datagram, in order
    targets: target of each frame; frames with the target `NO_TARGET` are not forwarded
    Returns a list of (target, offset of the first byte, offset after the last byte, number of frames).
    """
    if len(frames) == 1:
        return [(targets[0], frames[0][0], frames[0][1], 1)] if targets[0] != NO_TARGET else []
    runs: list[tuple[int, int, int, int]] = []
    target, start, end, count = NO_TARGET, 0, 0, 0
    for frame, own in zip(frames, targets, strict=True):
        if own == target and frame.start == end and frame.end - start <= MAX_DATAGRAM_BYTES:
            end, count = frame.end, count + 1
            continue
        if target != NO_TARGET:
            runs.append((target, start, end, count))
        target, start, end, count = own, frame.start, frame.end, 1
    if target != NO_TARGET:
        runs.append((target, start, end, count))
    return runs
