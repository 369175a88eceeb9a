"""Tests of letters and words as points."""

from __future__ import annotations

import string

import numpy as np
import pytest

from arena.errors import InputError
from arena.trajectories import letter_points, word_points

SIZE = {"width_m": 2.0, "height_m": 3.0, "spacing_m": 0.4}


@pytest.mark.parametrize("letter", string.ascii_uppercase)
def test_points_of_a_letter_are_inside_its_box_and_apart(letter):
    points = letter_points(letter, **SIZE)
    assert len(points) >= 5 and (points >= 0).all() and (points <= [2.0, 3.0]).all()
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)[*np.triu_indices(len(points), 1)]
    assert apart.min() >= 0.7 * 0.4 - 1e-9
    assert points[:, 1].max() == 3.0 and points[:, 1].min() == 0.0


def test_no_two_letters_have_the_same_points():
    shapes = {tuple(map(tuple, letter_points(letter, **SIZE).round(3))) for letter in string.ascii_uppercase}
    assert len(shapes) == 26


def test_letters_of_a_word_stand_side_by_side():
    letters = word_points("FL Y", gap_m=0.5, **SIZE)
    assert [points[:, 0].min() for points in letters] == [0.0, 2.5, 7.5]


def test_an_unknown_letter_is_refused():
    with pytest.raises(InputError, match="got '1'"):
        letter_points("1", **SIZE)
