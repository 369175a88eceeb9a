"""Tokenizer of one scenario entry: splits its text into words, numbers, units and operators.

A `WrongWordError` says which word was found and which was expected.
"""

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

# unit -> (kind of quantity, factor to the SI unit)
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
    """Error about a wrong word in a scenario, with the found and the expected word.

    The loader (`scenario`) adds file and line.
    """


@dataclass(frozen=True, kw_only=True)
class Token:
    """Word, number, unit, operator or quoted text in an entry of a scenario."""

    kind: Kind
    text: str


class TokenReader:
    """Reader of the tokens of one text, in order."""

    def __init__(self, text: str) -> None:
        self._tokens = [_token(found) for found in _TOKEN.finditer(text)]
        self._at = 0

    @property
    def next(self) -> Token:
        """Next token, without consuming it. After the last token, a token of the kind "end"."""
        return self._tokens[self._at] if self._at < len(self._tokens) else Token(kind="end", text="")

    def advance(self) -> Token:
        """Consume and return the next token."""
        token = self.next
        self._at += 1
        return token

    def accept(self, *texts: str) -> bool:
        """Consume the next tokens if they are exactly these texts. Return whether they were consumed."""
        ahead = [token.text for token in self._tokens[self._at : self._at + len(texts)]]
        if ahead != list(texts):
            return False
        self._at += len(texts)
        return True

    def error(self, expected: str, known: Sequence[str] = ()) -> WrongWordError:
        """Return a WrongWordError with the next token and what was expected instead.

        expected: what is allowed here, such as "expected a mode".  known: valid words at this place, for the hint.
        """
        token = self.next
        got = f"got {token.text!r}" if token.kind != "end" else "got nothing"
        after = f" after {self._tokens[self._at - 1].text!r}" if 0 < self._at <= len(self._tokens) else ""
        hint = _instead(token, expected, known)
        return WrongWordError(f"{got}{after}, {expected}." + (f" {hint}" if hint else ""))

    def one_of(self, known: Sequence[str], what: str) -> str:
        """Consume and return the next word, which must be in `known`. Raises WrongWordError for an unknown word.

        what: text after "expected" in the error message.
        """
        if self.next.text not in known or self.next.kind not in {"word", "sign", "unit"}:
            raise self.error(f"expected {what}", known)
        return self.advance().text

    def expect(self, text: str) -> None:
        """Consume the next token, which must be a given text. Otherwise raise WrongWordError."""
        if not self.accept(text):
            raise self.error(f"expected {text}", [text])

    def number(self, what: str) -> float:
        """Consume and return a number with an absolute value of at most a million.

        Raises WrongWordError for a different token.

        what: text after "expected" in the error message.
        """
        if self.next.kind != "number":
            raise self.error(f"expected {what}")
        value = float(self.next.text)
        if abs(value) > 1e6:
            raise self.error(f"expected {what} between -1000000 and 1000000")
        self.advance()
        return value

    def quantity(self, kind: str, what: str, *, least: float | None = None) -> float:
        """Consume a number with a unit and return it in SI units.

        Raises WrongWordError if the next tokens are different.

        kind: kind of the quantity, such as "time".  what: text after "expected" in the error message.
        least: exclusive lower limit, in the unit of the text.
        """
        before = self._at
        value = self.number(what)
        units = [unit for unit, (measures, _) in UNITS.items() if measures == kind]
        unit = self.one_of(units, f"the unit {' or '.join(units)}")
        if least is not None and value <= least:
            self._at = before
            raise self.error(f"expected more than {least:g} {unit}")
        return value * UNITS[unit][1]

    def end(self, might: str = "") -> None:
        """Raise WrongWordError if the entry has more words than expected.

        might: optional text that would be allowed here, such as "+ a time". The error message mentions it.
        """
        if self.next.kind != "end":
            raise self.error(
                f"expected {might} or nothing more" if might else "expected nothing more",
                might.split(" ", maxsplit=1)[:1],
            )


def _token(found: re.Match[str]) -> Token:
    kind = found.lastgroup
    text = found[kind or 0]
    if kind == "text":
        return Token(kind="text", text=text[1:-1])
    return Token(kind=kind, text=text)  # type: ignore[arg-type]  # the groups are the kinds


def _instead(token: Token, expected: str, known: Sequence[str]) -> str:
    """Return a hint for a wrong token, or "" if there is no hint.

    For an operator that scenarios do not have, such as `>=`, the hint is what to write instead. For another token, the hint is
    the most similar known word. Without a similar word, the hint is the list of known words, unless `expected` contains them.
    """
    if token.text in _SIGNS_INSTEAD:
        return f"Write {_SIGNS_INSTEAD[token.text]} instead."
    if not known:
        return ""
    hint = near(token.text, known)
    return "" if hint.startswith("Known") and all(word in expected for word in known) else hint
