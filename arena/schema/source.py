"""The YAML document after the `--set` overrides, with file and line of each value for messages."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Any

from arena.errors import InputError, Problem
from arena.schema.loader import Document, YamlPath, dotted, parse_scalar
from arena.schema.ranges import RangeMember, expand_ranges


@dataclass(frozen=True, kw_only=True)
class Source:
    """Values of a YAML document after the `--set` overrides, with file and line of each value for messages.

    document: the document as read from the file.
    data: values of the document with the overrides applied.
    overrides: paths that `--set` changed.
    ranges: vehicle -> the range of vehicles that names it.
    """

    document: Document
    data: Any
    overrides: tuple[YamlPath, ...] = ()
    ranges: Mapping[str, RangeMember] = field(default_factory=dict)

    def range_of(self, vehicle: str) -> RangeMember | None:
        """Return the range, such as `uav1..uav48`, that defines this vehicle. None if the YAML names the vehicle itself."""
        return self.ranges.get(vehicle)

    def given(self, path: YamlPath) -> bool:
        """Return whether the YAML or `--set` gives a non-null value at this YAML path."""
        here = self.data
        for part in path:
            in_dict = isinstance(here, dict) and part in here
            if in_dict or (isinstance(here, tuple) and isinstance(part, int) and part < len(here)):
                here = here[part]
            else:
                return False
        return here is not None

    def value(self, path: YamlPath) -> Any:
        """Return the value at a YAML path, or None without a value. Paths into lists are not supported."""
        here = self.data
        for part in path:
            here = here.get(part) if isinstance(here, dict) else None
        return here

    def layer(self, vehicle: str, *key: str) -> YamlPath:
        """Return the YAML path that sets a vehicle's key: `vehicles.NAME.KEY`, or `defaults.KEY` if only that is given."""
        own: YamlPath = ("vehicles", vehicle, *key)
        common: YamlPath = ("defaults", *key)
        return common if not self.given(own) and self.given(common) else own

    def place(self, path: YamlPath) -> tuple[str, int]:
        """Return (file, line) of a YAML key. If the file does not contain the key, use its nearest enclosing key.

        Values from `--set` have the place (`--set`, 0).
        """
        if any(path[: len(o)] == o for o in self.overrides):
            return "--set", 0
        if len(path) > 1 and path[0] == "vehicles" and (member := self.ranges.get(str(path[1]))) is not None:
            path = ("vehicles", member.key, *path[2:])
        return self.document.file, self.document.line(path)

    def origin(self, path: YamlPath) -> str:
        """Return where a value comes from, as text: `arena.yaml:14`, `--set` or `default`."""
        if not self.given(path):
            return "default"
        file, line = self.place(path)
        return f"{file}:{line}" if line else file

    def problem(self, path: YamlPath, message: str, at: YamlPath | None = None) -> Problem:
        """Return a `Problem` for the value at a YAML path: the message with file, line and key.

        at: path at which the value is written, if it is a different one, such as a path under `defaults`.
        """
        file, line = self.place(path if at is None else at)
        return Problem(file=file, line=line, field=dotted(path), message=message)


def with_overrides(document: Document, overrides: Sequence[str]) -> Source:
    """Apply `--set` overrides (`key=value` texts) to the document. Raises InputError with every wrong override."""
    expanded, ranges = expand_ranges(document)
    data, paths, problems = copy.deepcopy(expanded), [], []
    for text in overrides:
        try:
            paths.append(_lay(data, text))
        except InputError as error:
            why = error.problems[0].message if error.problems else str(error)
            problems.append(Problem(file=f"--set {text}", line=0, field="", message=why))
    if problems:
        raise InputError(problems)
    return Source(document=document, data=data, overrides=tuple(paths), ranges=ranges)


def _lay(data: Any, text: str) -> YamlPath:
    key, equals, value = text.partition("=")
    path = tuple(key.strip().split("."))
    if not equals or not all(path):
        raise InputError("expected key=value with a dotted key, such as mocap.rate_hz=120")
    here = data
    for i, part in enumerate(path):
        if not isinstance(here, dict):
            raise InputError(
                f"{'.'.join(path[:i]) or 'the file'} is not a mapping, so the key {part} cannot be set"
            )
        if i == len(path) - 1:
            here[part] = parse_scalar(value)
        else:
            if here.get(part) is None:
                here[part] = {}
            here = here[part]
    return path


def near(name: str, known: Sequence[str]) -> str:
    """Return a hint for an unknown name: the most similar known name, or else all known names."""
    close = (
        get_close_matches(name, list(known), n=1, cutoff=0.6) or [k for k in known if name and name in k][:1]
    )
    return f"Did you mean {close[0]}?" if close else f"Known: {', '.join(known)}."


def as_list(words: Sequence[str]) -> str:
    """Return words as a YAML list of texts. Words that look like numbers are quoted."""
    return "[" + ", ".join(w if isinstance(parse_scalar(w), str) else f"'{w}'" for w in words) + "]"


def show(value: Any) -> str:
    """Return a value in YAML notation, shortened for messages."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a mapping" if value else "{}"
    if isinstance(value, tuple):
        text = "[" + ", ".join(show(item) for item in value) + "]"
        return text if len(text) <= 60 else f"a list of {len(value)}"
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    return repr(value) if len(repr(value)) <= 60 else repr(value)[:57] + "..."
