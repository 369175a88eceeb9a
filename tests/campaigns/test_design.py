"""The flights of a sweep: grids, samples, ids."""

from __future__ import annotations

import json
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from arena.campaign.design import flights, listed_values, points
from arena.campaign.sampler import in_range, latin_hypercube, random_points, whole_numbers
from arena.campaign.sweep import Scale, Setting, Sweep
from arena.errors import InputError
from arena.schema.loader import parse_scalar

Load = Callable[[str], Sweep]


def test_grid_has_every_combination_with_every_seed(sweep_of: Load) -> None:
    sweep = sweep_of("seeds: [4, 7]\nvary:\n  a.b: [1, 2, 3]\n  c.d: [x, y]\n")
    found = flights(sweep)
    assert len(found) == 12 and [f.number for f in found] == list(range(1, 13))
    assert {(f.settings["a.b"], f.settings["c.d"], f.seed) for f in found} == {
        (a, c, s) for a in (1, 2, 3) for c in "xy" for s in (4, 7)
    }
    assert found[0].overrides == ("a.b=1", 'c.d="x"')


def test_sweep_without_settings_has_one_flight_per_seed(sweep_of: Load) -> None:
    assert [(f.seed, f.overrides) for f in flights(sweep_of("seeds: 2\nset: [a.b=3]\n"))] == [
        (1, ("a.b=3",)),
        (2, ("a.b=3",)),
    ]


def test_steps_divide_a_range(sweep_of: Load) -> None:
    sweep = sweep_of(
        "vary:\n  a: {min: 0, max: 1, steps: 5}\n  b: {min: 1, max: 100, steps: 3, scale: log}\n"
        "  c: {min: 1, max: 9, steps: 3, integer: true}\n"
    )
    found = points(sweep)
    assert len(found) == 45
    assert sorted({p["a"] for p in found}) == [0.0, 0.25, 0.5, 0.75, 1.0]  # type: ignore[type-var]
    assert sorted({p["b"] for p in found}) == [1.0, 10.0, 100.0]  # type: ignore[type-var]
    assert sorted({p["c"] for p in found}) == [1, 5, 9]  # type: ignore[type-var]


def test_samples_are_combined_with_the_grid_and_repeat(sweep_of: Load) -> None:
    text = "samples: 6\nvary:\n  a: {min: 2, max: 4}\n  b: [0, 1]\n  n: {min: 1, max: 3, integer: true}\n"
    found = points(sweep_of(text))
    assert len(found) == 12 and list(found[0]) == ["a", "b", "n"]
    assert found == points(sweep_of(text)) != points(sweep_of(f"sampling_seed: 2\n{text}"))
    assert all(2 <= p["a"] <= 4 and p["n"] in (1, 2, 3) for p in found)  # type: ignore[operator]
    assert {p["a"] for p in found if p["b"] == 0} == {p["a"] for p in found if p["b"] == 1}


def test_template_sets_several_keys(sweep_of: Load) -> None:
    sweep = sweep_of("vary:\n  w: {values: [3], set: ['world.wind_m_s=[{}, 0, 0]', 'world.gusts_m_s={}']}\n")
    assert flights(sweep)[0].overrides == ("world.wind_m_s=[3, 0, 0]", "world.gusts_m_s=3")


@pytest.mark.parametrize(
    "value", [1e-7, -2.5, True, None, "0x10", "yes", "a: b", [1, "x", [2.0]], {"k": [1]}]
)
def test_override_gives_the_value_of_the_sweep(sweep_of: Load, value: object) -> None:
    (flight,) = flights(sweep_of(f"vary:\n  a.b: {{values: [{json.dumps(value)}]}}\n"))
    parsed = parse_scalar(flight.overrides[0].removeprefix("a.b="))
    assert json.loads(json.dumps(parsed)) == value


def test_flight_keeps_its_id_when_the_sweep_grows(sweep_of: Load) -> None:
    small = flights(sweep_of("seeds: 2\nvary: {a: [1, 2]}\n"))
    large = flights(sweep_of("seeds: 5\nvary: {a: [0, 1, 2]}\n"))
    assert {f.id for f in small} < {f.id for f in large} and len({f.id for f in large}) == 15
    assert not {f.id for f in flights(sweep_of("set: [b=1]\nseeds: 5\nvary: {a: [1]}\n"))} & {
        f.id for f in large
    }


@pytest.mark.parametrize(
    "text",
    [
        "samples: 50\nvary: {n: {min: 1, max: 3, integer: true}}\n",
        "vary: {n: {min: 1, max: 10, steps: 10, integer: true, scale: log}}\n",
    ],
)
def test_equal_flights_are_refused(sweep_of: Load, text: str) -> None:
    with pytest.raises(InputError, match=r"flights \d+ and \d+ are the same \(n \d+\)"):
        flights(sweep_of(text))


@given(
    low=st.floats(-1e6, 1e6),
    width=st.floats(1e-6, 1e6),
    count=st.integers(2, 40),
    scale=st.sampled_from(["linear", "log"]),
)
def test_values_of_a_range_differ_and_stay_inside(low: float, width: float, count: int, scale: Scale) -> None:
    low = abs(low) + 1e-3 if scale == "log" else low
    high = low + width
    assume(high > low and (high - low) / max(abs(low), abs(high)) > 1e-9)
    values = [float(v) for v in listed_values(Setting(min=low, max=high, steps=count, scale=scale))]  # type: ignore[arg-type]
    assert len(set(values)) == count and low <= min(values) and max(values) <= high


def test_narrow_range_has_enough_digits(sweep_of: Load) -> None:
    text = "samples: 20\nvary: {world.origin.lat_deg: {min: 47.397740, max: 47.397840}}\n"
    found = [f.settings["world.origin.lat_deg"] for f in flights(sweep_of(text))]
    assert len(set(found)) == 20 and all(47.397740 <= v <= 47.397840 for v in found)  # type: ignore[operator]


def test_too_many_flights_are_refused(sweep_of: Load) -> None:
    with pytest.raises(InputError, match="got 200000 flights, expected at most 100000"):
        flights(sweep_of("seeds: 2\nsamples: 100000\nvary: {a: {min: 0, max: 1}}\n"))


@pytest.mark.parametrize("count", [1, 2, 7, 50])
def test_latin_hypercube_has_one_point_in_each_part(count: int) -> None:
    found = latin_hypercube(count, 3, np.random.default_rng(5))
    assert found.shape == (count, 3)
    for column in found.T:
        assert sorted(np.floor(column * count).astype(int)) == list(range(count))


def test_columns_of_a_latin_hypercube_are_independent() -> None:
    found = latin_hypercube(2000, 2, np.random.default_rng(1))
    assert abs(np.corrcoef(found.T)[0, 1]) < 0.1


def test_random_points_are_uniform() -> None:
    found = random_points(4000, 2, np.random.default_rng(1))
    assert found.min() >= 0 and found.max() < 1 and abs(found.mean() - 0.5) < 0.02


def test_log_scale_has_equal_ratios() -> None:
    found = in_range(np.array([0.0, 0.5, 1.0]), 0.01, 1.0, "log")
    assert found == pytest.approx([0.01, 0.1, 1.0])


def test_integers_have_equal_shares_and_include_both_ends() -> None:
    share = np.linspace(0, 1, 3000, endpoint=False)
    values, counts = np.unique(whole_numbers(share, 2, 4, "linear"), return_counts=True)
    assert list(values) == [2, 3, 4] and list(counts) == [1000, 1000, 1000]
    assert set(whole_numbers(share, 1, 10, "log")) == set(range(1, 11))
    assert not any(math.isnan(v) for v in values)
