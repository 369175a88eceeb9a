"""Missing ranges, against a set of single bytes."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from arena.log_download.missing_ranges import MissingRanges

PARTS = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 20)), max_size=12)


@given(size=st.integers(0, 60), parts=PARTS)
def test_missing_bytes_are_those_not_received(size: int, parts: list[tuple[int, int]]) -> None:
    missing, left = MissingRanges(size), set(range(size))
    for first, count in parts:
        part = set(range(first, first + count))
        assert missing.receive(first, first + count) is bool(part & left)
        left -= part
        assert {k for a, b in missing.ranges for k in range(a, b)} == left and missing.left == len(left)
        assert list(missing.ranges) == sorted(missing.ranges)
    again = MissingRanges(size, missing.ranges)
    assert again.ranges == missing.ranges
    assert (missing.first(5) is None) is (not left)
    if left:
        a, b = missing.first(5) or (0, 0)
        assert a == min(left) and set(range(a, b)) <= left and 0 < b - a <= 5
