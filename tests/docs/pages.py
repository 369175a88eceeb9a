"""Reader of the documentation pages and their code blocks. A notebook counts as a page: its text is that of its page on the site."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from notebook_page import notebook_page

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted(ROOT.glob("docs/*/*.ipynb"))
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *NOTEBOOKS])
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


def page_text(page: Path) -> str:
    """Return the text of a page as Markdown."""
    return notebook_page(page)[0] if page.suffix == ".ipynb" else page.read_text()


def blocks(*languages: str) -> list[Block]:
    return [b for page in PAGES for b in _of(page) if b.language in languages]


def _of(page: Path) -> list[Block]:
    text = page_text(page)
    found = []
    for match in _FENCE.finditer(text):
        body = match[3]
        language = match[2] or ("sh" if re.search(r"^(arena|make|pip|python) ", body, re.M) else "")
        found.append(
            Block(page=page, line=text.count("\n", 0, match.start()) + 1, language=language, text=body)
        )
    return found
