"""Cross-check of placeholders such as `{mass_kg}` in the arguments of programs and tools. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from arena.errors import Problem
from arena.schema.checking import Check
from arena.schema.loader import YamlPath
from arena.schema.placeholders import PLACEHOLDERS, known, names_in
from arena.schema.source import near
from arena.schema.tools import Tool


def placeholders(c: Check) -> Iterator[Problem]:
    """Refuse unknown placeholders in arguments, and placeholders for one vehicle in a tool that runs once per arena."""
    for path, texts, of_vehicle in _places(c):
        for text in texts:
            for message in _problems(text, of_vehicle=of_vehicle):
                yield c.source.problem(
                    path, message, at=c.where(str(path[1]), *map(str, path[2:])) if of_vehicle else None
                )


def _places(c: Check) -> Iterator[tuple[YamlPath, Sequence[str], bool]]:
    """Yield the arguments of programs and tools, which can contain placeholders, with their YAML path.

    Each item is (YAML path, arguments, True for a vehicle or False for the whole arena).
    """
    for v in c.arena.vehicles:
        yield ("vehicles", v.name, "args"), v.program.args if v.program is not None else (), True
        for name, tool in v.tools.items():
            yield ("vehicles", v.name, "tools", name), _texts(tool), True
    for name, tool in c.arena.tools.items():
        yield ("tools", name), _texts(tool), False


def _texts(tool: Tool) -> Sequence[str]:
    file = tool.ready.file if tool.ready is not None else None
    return (*tool.argv, *tool.env.values(), file or "")


def _problems(text: str, *, of_vehicle: bool) -> Iterator[str]:
    for name in names_in(text):
        row = PLACEHOLDERS.get(name)
        if row is None:
            names = known(of_vehicle=of_vehicle)
            hint = near(name, names)
            listed = "" if hint.startswith("Known") else f" Known: {', '.join(names)}."
            yield f"got {{{name}}}, which is no placeholder. {hint}{listed} Write {{{{{name}}}}} for the text {{{name}}}."
        elif row.of_vehicle and not of_vehicle:
            yield (
                f"got {{{name}}}, which belongs to one vehicle, but this tool belongs to the whole arena. "
                "Write the tool under the vehicle, or under `defaults` for each vehicle."
            )
