"""Extension of griffe for the API pages: the lines `name: meaning` of docstrings become lists.

In the source, each argument or attribute has a line of its own, indented or not. Markdown would join such lines to one paragraph.
"""

from __future__ import annotations

import inspect
import re
from typing import Any

import griffe

_FIELD = re.compile(r"^(?P<names>[a-z_]\w*(?:, [a-z_]\w*)*): (?P<text>.*)$")
_CODE_OR_BRACKET = re.compile(r"(?P<code>`[^`]*`)|\[(?=[^\]]*\](?!\())")
"""Code, which stays, or the bracket of a unit or frame, such as `[m]` and `[NED]`, which Markdown would read as a link."""


class DocstringFields(griffe.Extension):  # type: ignore[misc]
    """Rewrites the docstring of each loaded object with `as_markdown`."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite the docstring of an object. griffe calls this for each module, class, function and attribute."""
        if obj.docstring is not None:
            obj.docstring.value = as_markdown(obj.docstring.value)


def as_markdown(text: str) -> str:
    """Return a docstring with its lines `name: meaning` as a list. Indented lines after such a line belong to the same item."""
    lines: list[str] = []
    in_list = False
    for line in inspect.cleandoc(text).splitlines():
        if field := _FIELD.match(line):
            if lines and lines[-1] and not in_list:
                lines.append("")
            lines.append(f"- `{field['names']}`: {field['text']}")
            in_list = True
        elif in_list and line.startswith(" "):
            lines[-1] += " " + line.strip()
        else:
            if in_list and line:
                lines.append("")
            lines.append(line)
            in_list = False
    return "\n".join(_CODE_OR_BRACKET.sub(lambda found: found["code"] or r"\[", line) for line in lines)
