"""Writes a page with interactive figures as one HTML file that needs no network.

The file contains the templates, plotly.js and the data.

Large parts are compressed with gzip and coded in base64; the browser unpacks them (DecompressionStream, in all browsers since 2023).
plotly.js comes from the package `plotly`. That package contains only the complete bundle (4.8 MB, packed 2.0 MB). Smaller bundles
with three-dimensional plots exist on npm, but in no Python package.
"""

from __future__ import annotations

import base64
import functools
import gzip
import json
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from arena.geometry import Array
from arena.report.figures import Figure

_TEMPLATES = Path(__file__).parent / "page"
_LEVEL = 5  # of gzip: higher levels take twice as long and save 1 %


def render(
    template: str, content: Mapping[str, Any], figures: Mapping[str, Figure], options: Mapping[str, Any]
) -> str:
    """Return a page with figures as HTML text.

    template: file in the folder `page`.  content: variables of the template. All texts are escaped.
    figures: id of an element of the page -> figure.  options: settings for page.js, see there.
    """
    arrays = ArrayTable()
    payload = {"figures": arrays.without_arrays(figures), "options": options}
    payload["lengths"] = arrays.lengths
    return _environment().get_template(template).render(
        **content,
        css=(_TEMPLATES / "page.css").read_text(),
        javascript=(_TEMPLATES / "page.js").read_text(),
        plotly_js=_packed_plotly(),
        payload=_packed(_json(payload).encode()),
        arrays=_packed(arrays.data),
    )  # fmt: skip


@functools.cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number
    return environment


def number(value: float | None, digits: int = 2) -> str:
    """Format a number with a fixed number of decimals. An unknown number gives a dash.

    Zero gets no sign.
    """
    return "\u2013" if value is None or not np.isfinite(value) else f"{value:z.{digits}f}"


class ArrayTable:
    """Store of the number arrays of all figures on a page, which contains each array only once.

    Equal arrays are stored once, as float32.

    `lengths`: number of values of each array.
    """

    def __init__(self) -> None:
        self.lengths: list[int] = []
        self._chunks: list[bytes] = []
        self._known: dict[bytes, int] = {}

    @property
    def data(self) -> bytes:
        """Bytes of all arrays, one after the other, little endian."""
        return b"".join(self._chunks)

    def without_arrays(self, node: Any) -> Any:
        """Store the numpy arrays of a figure. Return a copy with `{"$": index}` in the place of each array.

        index: the array's index in the table.
        """
        if isinstance(node, np.ndarray):
            return {"$": self._index(node)}
        if isinstance(node, Mapping):
            return {key: self.without_arrays(value) for key, value in node.items()}
        if isinstance(node, list | tuple):
            return [self.without_arrays(value) for value in node]
        return node

    def _index(self, values: Array) -> int:
        chunk = np.ascontiguousarray(values, "<f4").tobytes()
        if chunk not in self._known:
            self._known[chunk] = len(self.lengths)
            self.lengths.append(values.size)
            self._chunks.append(chunk)
        return self._known[chunk]


def _json(value: Any) -> str:
    return json.dumps(_finite(value), separators=(",", ":"), allow_nan=False)


def _finite(node: Any) -> Any:
    """Return a copy of a value with None in place of NaN and infinity, which JSON cannot contain."""
    if isinstance(node, float):
        return node if np.isfinite(node) else None
    if isinstance(node, dict):
        return {key: _finite(value) for key, value in node.items()}
    return [_finite(value) for value in node] if isinstance(node, list) else node


def _packed(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, _LEVEL, mtime=0)).decode()


@functools.cache
def _packed_plotly() -> str:
    return _packed((files("plotly") / "package_data" / "plotly.min.js").read_bytes())
