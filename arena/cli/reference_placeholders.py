"""Reference page of the placeholders in the arguments of programs and tools."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from arena.schema.placeholders import PLACEHOLDERS, variable

Table = Callable[[Iterable[str], Iterable[Iterable[str]]], str]

_HEAD = """# Placeholders

`args` of a program, and `argv` and `env` of a tool can contain placeholders: `{mass_kg}` becomes the vehicle's mass.
Programs and tools have the same values in their environment.
[Programs in other languages](../howto/programs-in-other-languages.md) shows their use.

- Values of one vehicle exist for its program and its tools. Tools of the whole arena have only the values of the arena.
- `{{name}}` stands for the text `{name}`. All other braces are text.
- The arguments are not read by a shell.
- Programs of a group have no such environment variables, because they share a process.

"""


def placeholders_page(table: Table) -> str:
    """Return the page of all placeholders, with their environment variables, as Markdown.

    table: function that makes a table in Markdown.
    """
    rows = (
        (
            f"`{{{name}}}`",
            "" if name == "rt" else f"`{variable(name)}`",
            "one vehicle" if row.of_vehicle else "the arena",
            row.meaning,
        )
        for name, row in PLACEHOLDERS.items()
    )
    return _HEAD + table(("placeholder", "environment variable", "belongs to", "value"), rows)
