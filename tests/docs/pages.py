"""Reader of the documentation pages and their code blocks."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
_FENCE = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.M | re.S)


@dataclass(frozen=True, kw_only=True)
class Block:
    """A code block of a page. language: as given; `sh` if none is given and a line begins with `arena`."""

    page: Path
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(*languages: str) -> list[Block]:
    return [b for page in PAGES for b in _of(page) if b.language in languages]


def _of(page: Path) -> list[Block]:
    text = page.read_text()
    found = []
    for match in _FENCE.finditer(text):
        body = match[3]
        language = match[2] or ("sh" if re.search(r"^(arena|make|pip|python) ", body, re.M) else "")
        found.append(
            Block(page=page, line=text.count("\n", 0, match.start()) + 1, language=language, text=body)
        )
    return found
