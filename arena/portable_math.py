"""Functions of arrays whose results are equal, bit for bit, on all CPUs of one architecture. Pure.

numpy's sin and exp, for example, and its matrix products use the newest instructions of the CPU, so their results can differ in the last
bit on another CPU. A simulated flight with a seed must be the same on two computers. So code that changes a flight uses these functions.
They call Python's `math` for each element, or add in a fixed order. They are slower than numpy: what runs in every step is a kernel.

An element without a result, such as the sine of infinity, is NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
_LEAST_PIVOT = 1e-12  # part of the largest element


def for_arrays(function: Callable[..., float], arguments: int) -> Callable[..., Any]:
    """Make a function of numbers work on arrays of any shape: it is called for each element. For numbers it returns a number.

    arguments: number of arguments of the function
    """

    def of_numbers(*numbers: float) -> float:
        try:
            return function(*numbers)
        except (ValueError, OverflowError):
            return math.nan

    of_elements = np.frompyfunc(of_numbers, arguments, 1)

    def of_arrays(*arrays: ArrayLike) -> Any:
        with np.errstate(all="ignore"):  # math sets the flags that numpy would report
            return np.asarray(of_elements(*arrays), np.float64)[()]

    return of_arrays


sin, cos, tan = (for_arrays(each, 1) for each in (math.sin, math.cos, math.tan))
arcsin, arccos, arctan = (for_arrays(each, 1) for each in (math.asin, math.acos, math.atan))
exp = for_arrays(math.exp, 1)
arctan2, power = for_arrays(math.atan2, 2), for_arrays(math.pow, 2)


def product(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the product (..., k) of vectors or matrices a (..., m) and a matrix b (m, k)."""
    return np.asarray(np.einsum("...j,jk->...k", np.asarray(a, np.float64), np.asarray(b, np.float64)))


def norm(vector: ArrayLike) -> float:
    """Return the length of a vector (n,)."""
    return math.sqrt(math.fsum(x * x for x in np.asarray(vector, np.float64).tolist()))


def solve(matrix: ArrayLike, right: ArrayLike) -> Array:
    """Return the solution X (n, k) of `matrix @ X` = `right`, by Gauss-Jordan elimination.

    matrix: (n, n), of rank n.  right: (n, k). Raises ValueError for a lower rank.
    """
    rows = np.concatenate([np.asarray(matrix, np.float64), np.asarray(right, np.float64)], axis=1)
    count = len(rows)
    least = _LEAST_PIVOT * np.abs(rows[:, :count]).max()
    for i in range(count):
        best = i + int(np.argmax(np.abs(rows[i:, i])))
        rows[[i, best]] = rows[[best, i]]
        if abs(rows[i, i]) <= least:
            raise ValueError(f"got a matrix of a lower rank than {count}")
        rows[i] /= rows[i, i]
        factors = rows[:, i].copy()
        factors[i] = 0.0
        rows -= factors[:, None] * rows[i]
    return rows[:, count:]


def right_inverse(matrix: ArrayLike) -> Array:
    """Return the matrix X (m, n) of least norm with `matrix @ X` = identity.

    matrix: (n, m), of rank n. Raises ValueError for a lower rank.
    """
    rows = np.asarray(matrix, np.float64)
    return np.ascontiguousarray(solve(product(rows, rows.T), rows).T)
