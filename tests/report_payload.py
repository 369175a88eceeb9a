"""Reads the data of the figures back from the page of a report."""

from __future__ import annotations

import base64
import gzip
import json
import re
import struct
from typing import Any

import numpy as np


def payload(page: str) -> dict[str, Any]:
    """Return the figures and options that a page contains, with the arrays as numpy arrays."""
    found = json.loads(_unpacked(page, "payload"))
    data, at, arrays = _unpacked(page, "arrays"), 0, []
    for length in found["lengths"]:
        arrays.append(np.array(struct.unpack_from(f"<{length}f", data, at)))
        at += 4 * length
    return _resolved(found, arrays)


def _unpacked(page: str, element: str) -> bytes:
    match = re.search(rf'id="{element}">([^<]*)<', page)
    assert match, element
    return gzip.decompress(base64.b64decode(match[1]))


def _resolved(node: Any, arrays: list[np.ndarray]) -> Any:
    if isinstance(node, dict):
        return arrays[node["$"]] if "$" in node else {k: _resolved(v, arrays) for k, v in node.items()}
    return [_resolved(v, arrays) for v in node] if isinstance(node, list) else node


def traces(page: str, figure: str, **meta: str) -> list[dict[str, Any]]:
    """Return the traces of a figure whose `meta` has these values."""
    data = payload(page)["figures"][figure]["data"]
    return [t for t in data if meta.items() <= t.get("meta", {}).items()]
