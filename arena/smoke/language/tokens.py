"""A line of a scenario as words, numbers and signs, read one after the other; whoever meets the wrong one says what it was."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from arena.schema.source import near

_TOKEN = re.compile(
    r"""\s*(?: (?P<text>"[^"]*")
             | (?P<unit>m/s(?![A-Za-z0-9_]) | %)
             | (?P<number>-?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)
             | (?P<word>[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z0-9_]+)*)
             | (?P<sign>==|!=|<=|>=|=>|=<|&&|\|\||\S) )""",
    re.VERBOSE,
)
Kind = Literal["text", "unit", "number", "word", "sign", "end"]

# unit -> (what it measures, how much of the SI unit it is)
UNITS: dict[str, tuple[str, float]] = {
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "m": ("distance", 1.0),
    "cm": ("distance", 1e-2),
    "m/s": ("speed", 1.0),
    "deg": ("angle", 0.017453292519943295),
    "%": ("share", 1e-2),
}
_SIGNS_INSTEAD = {
    "<=": "<",
    ">=": ">",
    "=<": "<",
    "=>": ">",
    "=": "==",
    "&&": "a further entry",
    "||": "or",
    "!": "not",
}


class WrongWordError(Exception):
    """What was found, what was expected and what to do; becomes a Problem with its place."""


@dataclass(frozen=True, kw_only=True)
class Token:
    kind: Kind
    text: str


class Words:
    """The tokens of one text, and where reading is."""

    def __init__(self, text: str) -> None:
        self._tokens = [_token(found) for found in _TOKEN.finditer(text)]
        self._at = 0

    @property
    def next(self) -> Token:
        """Not taken yet."""
        return self._tokens[self._at] if self._at < len(self._tokens) else Token(kind="end", text="")

    def take(self) -> Token:
        token = self.next
        self._at += 1
        return token

    def took(self, *texts: str) -> bool:
        """Whether these come next; they are taken then."""
        ahead = [token.text for token in self._tokens[self._at : self._at + len(texts)]]
        if ahead != list(texts):
            return False
        self._at += len(texts)
        return True

    def wrong(self, expected: str, known: Sequence[str] = ()) -> WrongWordError:
        """About the token that comes next. known: words that would have been right."""
        token = self.next
        got = f"got {token.text!r}" if token.kind != "end" else "got nothing"
        after = f" after {self._tokens[self._at - 1].text!r}" if 0 < self._at <= len(self._tokens) else ""
        hint = _instead(token, expected, known)
        return WrongWordError(f"{got}{after}, expected {expected}." + (f" {hint}" if hint else ""))

    def one_of(self, known: Sequence[str], what: str) -> str:
        """The next word, which must be one of these."""
        if self.next.text not in known or self.next.kind not in {"word", "sign", "unit"}:
            raise self.wrong(what, known)
        return self.take().text

    def literal(self, text: str) -> None:
        if not self.took(text):
            raise self.wrong(text, [text])

    def number(self, what: str) -> float:
        """A plain number, finite."""
        if self.next.kind != "number":
            raise self.wrong(what)
        value = float(self.next.text)
        if abs(value) > 1e6:
            raise self.wrong(f"{what} below a million")
        self.take()
        return value

    def measure(self, kind: str, what: str, *, least: float | None = None) -> float:
        """A number and a unit of this kind, in SI. least: it must be more than that."""
        before = self._at
        value = self.number(what)
        units = [unit for unit, (measures, _) in UNITS.items() if measures == kind]
        unit = self.one_of(units, f"the unit {' or '.join(units)}")
        if least is not None and value <= least:
            self._at = before
            raise self.wrong(f"more than {least:g} {unit}")
        return value * UNITS[unit][1]

    def end(self, might: str = "") -> None:
        """Nothing may follow. might: what could have."""
        if self.next.kind != "end":
            raise self.wrong(
                f"{might} or nothing more" if might else "nothing more", might.split(" ", maxsplit=1)[:1]
            )


def _token(found: re.Match[str]) -> Token:
    kind = found.lastgroup
    text = found[kind or 0]
    if kind == "text":
        return Token(kind="text", text=text[1:-1])
    return Token(kind=kind, text=text)  # type: ignore[arg-type]  # the groups are the kinds


def _instead(token: Token, expected: str, known: Sequence[str]) -> str:
    """A hint: the sign meant, the nearest of the known words, or all of them where they are not said yet."""
    if token.text in _SIGNS_INSTEAD:
        return f"Write {_SIGNS_INSTEAD[token.text]} instead."
    if not known:
        return ""
    hint = near(token.text, known)
    return "" if hint.startswith("Known") and all(word in expected for word in known) else hint
