"""Points on the strokes of letters and words, for formations with one vehicle per point. Pure.

A letter is a list of strokes on a grid of width 1 and height 1. Points that two strokes share are taken once.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from arena.errors import InputError
from arena.geometry import Array
from arena.portable_math import norm

_Point = tuple[float, float]

STROKES: dict[str, Sequence[Sequence[_Point]]] = {
    "A": [[(0, 0), (0.5, 1), (1, 0)], [(0.2, 0.4), (0.8, 0.4)]],
    "B": [[(0, 0), (0, 1), (0.8, 0.9), (0.8, 0.6), (0, 0.5), (1, 0.4), (1, 0.1), (0, 0)]],
    "C": [[(1, 0.9), (0.6, 1), (0.2, 0.9), (0, 0.5), (0.2, 0.1), (0.6, 0), (1, 0.1)]],
    "D": [[(0, 0), (0, 1), (0.6, 0.95), (1, 0.6), (1, 0.4), (0.6, 0.05), (0, 0)]],
    "E": [[(1, 1), (0, 1), (0, 0), (1, 0)], [(0, 0.5), (0.8, 0.5)]],
    "F": [[(0, 0), (0, 1), (1, 1)], [(0, 0.5), (0.7, 0.5)]],
    "G": [[(1, 0.9), (0.6, 1), (0.2, 0.9), (0, 0.5), (0.2, 0.1), (0.6, 0), (1, 0.1), (1, 0.45), (0.6, 0.45)]],
    "H": [[(0, 0), (0, 1)], [(1, 0), (1, 1)], [(0, 0.5), (1, 0.5)]],
    "I": [[(0.5, 0), (0.5, 1)]],
    "J": [[(0.8, 1), (0.8, 0.2), (0.4, 0), (0, 0.2)]],
    "K": [[(0, 0), (0, 1)], [(1, 1), (0, 0.45), (1, 0)]],
    "L": [[(0, 1), (0, 0), (1, 0)]],
    "M": [[(0, 0), (0, 1), (0.5, 0.4), (1, 1), (1, 0)]],
    "N": [[(0, 0), (0, 1), (1, 0), (1, 1)]],
    "O": [
        [(0.5, 1), (0.1, 0.85), (0, 0.5), (0.1, 0.15), (0.5, 0), (0.9, 0.15), (1, 0.5), (0.9, 0.85), (0.5, 1)]
    ],
    "P": [[(0, 0), (0, 1), (0.8, 1), (1, 0.75), (0.8, 0.5), (0, 0.5)]],
    "Q": [
        [
            (0.5, 1),
            (0.1, 0.85),
            (0, 0.5),
            (0.1, 0.15),
            (0.5, 0),
            (0.9, 0.15),
            (1, 0.5),
            (0.9, 0.85),
            (0.5, 1),
        ],
        [(0.65, 0.3), (1, 0)],
    ],
    "R": [[(0, 0), (0, 1), (0.8, 1), (1, 0.75), (0.8, 0.5), (0, 0.5)], [(0.4, 0.5), (1, 0)]],
    "S": [[(1, 0.9), (0.5, 1), (0, 0.8), (0.1, 0.6), (0.9, 0.4), (1, 0.2), (0.5, 0), (0, 0.1)]],
    "T": [[(0, 1), (1, 1)], [(0.5, 1), (0.5, 0)]],
    "U": [[(0, 1), (0, 0.2), (0.5, 0), (1, 0.2), (1, 1)]],
    "V": [[(0, 1), (0.5, 0), (1, 1)]],
    "W": [[(0, 1), (0.25, 0), (0.5, 0.7), (0.75, 0), (1, 1)]],
    "X": [[(0, 0), (1, 1)], [(0, 1), (1, 0)]],
    "Y": [[(0, 1), (0.5, 0.5), (1, 1)], [(0.5, 0.5), (0.5, 0)]],
    "Z": [[(0, 1), (1, 1), (0, 0), (1, 0)]],
}


def letter_points(letter: str, *, width_m: float, height_m: float, spacing_m: float) -> Array:
    """Return points on the strokes of a letter (n, 2) [m].

    The points are right and up from the lower left corner of the letter.

    letter: A to Z.  width_m, height_m: size of the letter [m].
    spacing_m: distance between two points of a stroke [m], at most; no two points are nearer than 0.7 of it.
    Raises InputError for a letter that is not in `STROKES`.
    """
    if letter.upper() not in STROKES:
        raise InputError(f"letter: got {letter!r}, expected one of {''.join(sorted(STROKES))}")
    size = np.array([width_m, height_m])
    points: list[Array] = []
    for stroke in STROKES[letter.upper()]:
        corners = np.array(stroke, float) * size
        for start, end in itertools.pairwise(corners):
            count = max(1, int(np.ceil(norm(end - start) / spacing_m - 1e-9)))
            for place in start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start):
                if all(norm(place - other) >= 0.7 * spacing_m for other in points):
                    points.append(place)
    return np.array(points)


def word_points(word: str, *, width_m: float, height_m: float, spacing_m: float, gap_m: float) -> list[Array]:
    """Return the points of each letter of a word [m], one array (n, 2) per letter.

    The points are right and up from the lower left corner of the word.

    gap_m: space between two letters [m]. The other arguments are those of `letter_points`. Spaces have the width of a letter.
    """
    found = []
    for k, letter in enumerate(word):
        if letter != " ":
            points = letter_points(letter, width_m=width_m, height_m=height_m, spacing_m=spacing_m)
            found.append(points + np.array([k * (width_m + gap_m), 0.0]))
    return found
