"""Strict YAML reader: converts text to plain Python values, with the line number of each value.

Scalars follow YAML 1.2. Duplicate keys and tags are refused; all duplicates are reported at once. The reader uses PyYAML's
composer, because it keeps line numbers, and not PyYAML's constructor.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import yaml
from yaml.composer import Composer
from yaml.parser import Parser
from yaml.reader import Reader
from yaml.resolver import BaseResolver
from yaml.scanner import Scanner

from arena.errors import InputError, Problem

YamlPath = tuple[str | int, ...]

_MOST_FAST = 8_000  # characters that libyaml parses; it does not limit the depth, and a longer text could overflow the stack
_MOST_VALUES = 100_000  # with aliases, a small file can expand to a huge number of values


@dataclass(frozen=True, kw_only=True)
class Document:
    """A parsed YAML file: its values, and the line of each value.

    file: path of the file, for messages.
    data: plain values; mappings are dicts, sequences are tuples.
    lines: path of a value -> line of its key or list item (the first line is 1).
    """

    file: str
    data: Any
    lines: dict[YamlPath, int] = field(default_factory=dict)

    def line(self, path: YamlPath) -> int:
        """Return the line of the value at a YAML path, or of the nearest enclosing key in the file."""
        for end in range(len(path), -1, -1):
            if path[:end] in self.lines:
                return self.lines[path[:end]]
        return 1


_START = "`vehicles:`, or run `arena init`"


def load_yaml(path: str | Path, start: str = _START) -> Document:
    """Read a YAML file and return its values with their lines.

    start: first line of a valid file, for the error message if the file is empty.
    Raises InputError when the file cannot be read, is not YAML, or has a key twice.
    """
    try:
        text = Path(path).read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputError(
            Problem(file=str(path), line=0, field="", message=f"cannot be read: {error.strerror}")
        ) from error
    except UnicodeDecodeError as error:
        said = f"byte {error.start} is not UTF-8 text. Save the file as UTF-8"
        raise InputError(Problem(file=str(path), line=0, field="", message=said)) from error
    return parse_yaml(text, str(path), start)


def parse_yaml(text: str, file: str, start: str = _START) -> Document:
    """Parse YAML text. Raises InputError with every problem.

    file: file name for messages.
    start: first line of a valid file, for the error message if the text is empty.
    """
    node = _compose(text, file)
    if node is None:
        raise InputError(Problem(file=file, line=0, field="", message=f"is empty. Start with {start}"))
    walk = _Walk(file)
    try:
        data = walk.value(node, ())
    except RecursionError as error:
        raise InputError(Problem(file=file, line=1, field="", message="is nested too deeply")) from error
    if walk.problems:
        raise InputError(walk.problems)
    return Document(file=file, data=data, lines=walk.lines)


def parse_scalar(text: str) -> Any:
    """Parse the value of `--set key=VALUE`: a YAML scalar or flow collection."""
    return parse_yaml(text, "--set").data if text.strip() else None


def dump_yaml(data: Any) -> str:
    """Return plain values as YAML text. `parse_yaml` reads the same values back.

    Lists become tuples.
    """
    return yaml.dump(
        data, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=120, allow_unicode=True
    )


def _compose(text: str, file: str) -> yaml.Node | None:
    if _FastLoader is not None and len(text) <= _MOST_FAST:
        with contextlib.suppress(yaml.YAMLError):  # the messages of the loader below are better
            return cast("yaml.Node | None", _FastLoader(text).get_single_node())
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        said = " ".join(part for part in (error.problem, error.context) if part)
        hint = ". Indent with spaces, not tabs" if "\\t" in said else ""
        line = mark.line + 1 if mark else 0
        raise InputError(
            Problem(file=file, line=line, field="", message=f"is not YAML: {said}{hint}")
        ) from error
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, int(error.position)) + 1
        said = f"contains the character {error.character!r}, which YAML does not allow"
        raise InputError(Problem(file=file, line=line, field="", message=said)) from error
    except RecursionError as error:
        raise InputError(Problem(file=file, line=1, field="", message="is nested too deeply")) from error
    return node


class _Resolver(BaseResolver):
    """YAML rules that determine the type of an unquoted value.

    As in YAML 1.2, `no`, `on` and `12:30` are text, 010 is 10, 1e-3 is a number, `<<` is a key.
    """


class _Loader(Reader, Scanner, Parser, Composer, _Resolver):
    def __init__(self, stream: str) -> None:
        Reader.__init__(self, stream)
        Scanner.__init__(self)
        Parser.__init__(self)
        Composer.__init__(self)
        _Resolver.__init__(self)


_FastLoader: Any = None
if yaml.__with_libyaml__:
    from yaml.cyaml import CParser  # type: ignore[attr-defined]

    class _CLoader(CParser, _Resolver):
        """PyYAML loader that uses the C library libyaml. It is about ten times as fast as the Python loader."""

        def __init__(self, stream: str) -> None:
            CParser.__init__(self, stream)
            _Resolver.__init__(self)

    _FastLoader = _CLoader

_TAG = "tag:yaml.org,2002:"


def _float(text: str) -> float:
    plain = text.lower().replace(".inf", "inf").replace(".nan", "nan")
    return float(plain)


def _int(text: str) -> int:
    if text.startswith(("0o", "0x")):
        return int(text, 0)
    return int(text)


_KINDS: tuple[tuple[str, str, Callable[[str], Any]], ...] = (
    ("null", r"~|null|Null|NULL|", lambda text: None),
    ("bool", r"true|True|TRUE|false|False|FALSE", lambda text: text.lower() == "true"),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", _int),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        _float,
    ),
)
for _name, _pattern, _ in _KINDS:
    _Resolver.add_implicit_resolver(_TAG + _name, re.compile(f"^(?:{_pattern})$"), None)


# libyaml's emitter writes the same text in a fifth of the time
_SafeDumper: Any = yaml.CSafeDumper if yaml.__with_libyaml__ else yaml.SafeDumper


class _Dumper(_SafeDumper):  # type: ignore[misc]
    """YAML writer that quotes texts which `_Resolver` would read as another type."""

    yaml_implicit_resolvers = _Resolver.yaml_implicit_resolvers

    def ignore_aliases(self, data: Any) -> bool:
        return True


_MAKERS: dict[str, Callable[[str], Any]] = {_TAG + name: make for name, _, make in _KINDS} | {
    _TAG + "str": str
}


class _Walk:
    """Converter from PyYAML's nodes to plain values. It collects the line of each value and all problems."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.lines: dict[YamlPath, int] = {}
        self.problems: list[Problem] = []
        self._open: set[int] = set()
        self._count = 0

    def value(self, node: yaml.Node, path: YamlPath) -> Any:
        self._count += 1
        if self._count > _MOST_VALUES:
            raise InputError(
                Problem(
                    file=self.file,
                    line=_line(node),
                    field="",
                    message=f"expands to more than {_MOST_VALUES} values through its aliases",
                )
            )
        if id(node) in self._open:
            self._complain(node, path, "contains itself through an alias")
            return None
        self._open.add(id(node))
        try:
            return self._inside(node, path)
        finally:
            self._open.discard(id(node))

    def _inside(self, node: yaml.Node, path: YamlPath) -> Any:
        if isinstance(node, yaml.MappingNode) and node.tag == _TAG + "map":
            return self._mapping(node, path)
        if isinstance(node, yaml.SequenceNode) and node.tag == _TAG + "seq":
            return self._sequence(node, path)
        if isinstance(node, yaml.ScalarNode) and node.tag in _MAKERS:
            return self._scalar(node, path)
        self._complain(
            node, path, f"got the tag {node.tag.replace(_TAG, '!!')}, expected plain values. Remove the tag"
        )
        return None

    def _scalar(self, node: yaml.ScalarNode, path: YamlPath) -> Any:
        try:
            return _MAKERS[node.tag](node.value)
        except ValueError:
            self._complain(
                node, path, f"got {node.value[:40]!r}, which is not a valid {node.tag.removeprefix(_TAG)}"
            )
            return None

    def _sequence(self, node: yaml.SequenceNode, path: YamlPath) -> tuple[Any, ...]:
        for i, item in enumerate(node.value):
            self.lines[(*path, i)] = _line(item)
        return tuple(self.value(item, (*path, i)) for i, item in enumerate(node.value))

    def _mapping(self, node: yaml.MappingNode, path: YamlPath) -> dict[str, Any]:
        made: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = self._key(key_node, path)
            if key is None:
                continue
            here = (*path, key)
            if key in made:
                said = f"is given twice, on lines {self.lines[here]} and {_line(key_node)}. Keep one of them"
                self._complain(key_node, here, said)
                continue
            self.lines[here] = _line(key_node)
            made[key] = self.value(value_node, here)
        return made

    def _key(self, node: yaml.Node, path: YamlPath) -> str | None:
        if isinstance(node, yaml.ScalarNode) and node.tag == _TAG + "str":
            return str(node.value)
        shown = repr(node.value) if isinstance(node, yaml.ScalarNode) else "a collection"
        self._complain(node, path, f"got the key {shown}, expected text. If it is a name, put it in quotes")
        return None

    def _complain(self, node: yaml.Node, path: YamlPath, message: str) -> None:
        self.problems.append(Problem(file=self.file, line=_line(node), field=dotted(path), message=message))


def _line(node: yaml.Node) -> int:
    return int(node.start_mark.line) + 1


def dotted(path: YamlPath) -> str:
    """Return a YAML path as text: `("start", "position", 0)` -> `start.position[0]`."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text
