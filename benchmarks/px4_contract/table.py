"""Tables of the comparison in Markdown, for docs/builtin-autopilot.md. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from px4_contract.transcript import Difference, Seen

BEGIN, END = "<!-- contract: begin, written by benchmarks/contract.py -->", "<!-- contract: end -->"
_LONG = 90


def text(seen: Seen | None) -> str:
    """Return an observation as one cell of a table."""
    if seen is None:
        return "not observed"
    words = str(seen).replace("|", "/").replace("\n", " ")
    return words if len(words) <= _LONG else words[: _LONG - 3] + "..."


def summary(cases: Mapping[str, str], sizes: Mapping[str, int], differences: Sequence[Difference]) -> str:
    """Return a table with one row for each case. cases: description by name; sizes: observations by name."""
    rows = ["| case | what | observations | differ |", "|---|---|---|---|"]
    for name, size in sizes.items():
        found = sum(d.key.startswith(f"{name}: ") for d in differences)
        rows.append(f"| {name} | {cases[name]} | {size} | {found or ''} |")
    rows.append(f"| **all** | | **{sum(sizes.values())}** | **{len(differences)}** |")
    return "\n".join(rows)


def reasons(differences: Sequence[Difference]) -> str:
    """Return a table of the differences, grouped by reason."""
    by_reason: dict[str, list[Difference]] = {}
    for d in differences:
        by_reason.setdefault(d.reason or "**not explained**", []).append(d)
    rows = ["| reason | observations, such as | PX4 v1.16 | built-in |", "|---|---|---|---|"]
    for reason, found in by_reason.items():
        first = found[0]
        more = f" and {len(found) - 1} more" if len(found) > 1 else ""
        rows.append(
            f"| {reason} | {first.key.replace('|', '/')}{more} | {text(first.px4)} | {text(first.builtin)} |"
        )
    return "\n".join(rows)


def section(cases: Mapping[str, str], sizes: Mapping[str, int], differences: Sequence[Difference]) -> str:
    """Return the section of the page, including its start and end marks."""
    return "\n\n".join(
        [BEGIN, summary(cases, sizes, differences), "What differs, and why:", reasons(differences), END]
    )


def put_into(page: str, new: str) -> str:
    """Return the page with its section replaced, or appended if it has none."""
    if BEGIN in page and END in page:
        return page[: page.index(BEGIN)] + new + page[page.index(END) + len(END) :]
    return page.rstrip() + "\n\n## The contract, compared\n\n" + new + "\n"
