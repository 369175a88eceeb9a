"""Program that writes px4_parameters.csv from the parameters.xml or parameters.json of PX4 builds.

    python -m arena.params.facts.regenerate DIR                         read DIR/<version>/*.xml and *.json; later files win
    python -m arena.params.facts.regenerate FILE --version 1.16         replace the rows of that version
    python -m arena.params.facts.regenerate FILE --version 1.16 --over  replace or add the parameters of the file only

The file of a single build has only the parameters of its board and modules: use `--over` for such a file. `--tree` is the path
of PX4's source tree of that version, which is searched to fill the column `source`. For DIR, the file DIR/<version>/tree.txt can
contain this path. Without the tree every parameter keeps its source. `--of` is the tag or commit; write `~` before it if it is
not a release of the version. Only names, types, units and numbers are copied, never PX4's descriptions.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import lzma
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

from arena.errors import InputError
from arena.params.facts.parameter_table import COLUMNS, CSV

TABLE = Path(__file__).with_name(CSV)
_NAME = re.compile(r"[A-Z0-9_]{1,16}")  # others belong to nodes on the CAN bus
_MINOR = re.compile(r"v?(\d+\.\d+)(?:\.\d+)?")
_IN_C = re.compile(r"PARAM_DEFINE_(?:INT32|FLOAT)\s*\(\s*(\w+)")
_IN_YAML = re.compile(
    r"(?m)^\s*(?:- )?(?:name|param_prefix)?:?\s*['\"]?((?:[A-Z0-9_]|\$\{\w+\}){3,}?)['\"]?:?\s*$"
)
_GENERATED = {
    "SER_": "../Tools/serial/generate_config.py",
    "PWM_": "drivers/pwm_out/module.yaml",
}
"""Prefix of generated parameters, whose names are in no file -> script or file that generates them."""


class Fact(NamedTuple):
    """Properties of one parameter in px4_parameters.csv, as text."""

    type: str
    unit: str
    default: str
    min: str
    max: str
    reboot: str


class Table(NamedTuple):
    """Content of px4_parameters.csv: the parameters of each PX4 version, with their source files in PX4.

    facts: version -> parameter name -> properties.
    sources: version -> parameter name -> file in PX4's source tree.
    of: version -> `=` or `~`, followed by the tag or commit.
    """

    facts: dict[str, dict[str, Fact]]
    sources: dict[str, dict[str, str]]
    of: dict[str, str]


def read_xml(data: bytes) -> dict[str, Fact]:
    """Parse a parameters.xml of PX4. Return {parameter name: properties}."""
    found = {}
    for node in ElementTree.fromstring(data).iter("parameter"):
        text = {child.tag: (child.text or "").strip() for child in node}
        reboot = text.get("reboot_required", "").lower() == "true"
        name = node.attrib["name"]
        found[name] = _fact(
            name,
            node.attrib["type"],
            text.get("unit"),
            node.attrib["default"],
            text.get("min"),
            text.get("max"),
            reboot,
        )
    return _named(found)


def read_json(data: bytes) -> dict[str, Fact]:
    """Parse a parameters.json of PX4. Return {parameter name: properties}.

    Prefer parameters.xml. Up to 1.18 the JSON file sets rebootRequired for parameters that do not need a reboot (14 in 1.16).
    """
    rows: list[dict[str, Any]] = json.loads(data)["parameters"]
    return _named({row["name"]: _row(row) for row in rows})


def _row(row: Mapping[str, Any]) -> Fact:
    reboot = str(row.get("rebootRequired", "")).lower() == "true"
    return _fact(
        row["name"], row["type"], row.get("units"), row["default"], row.get("min"), row.get("max"), reboot
    )


def read(path: Path) -> dict[str, Fact]:
    """Read a parameter file of PX4 (.xml, .json, .xml.xz or .json.xz). Return {parameter name: properties}."""
    data = path.read_bytes()
    name = path.name
    if name.endswith(".xz"):
        data, name = lzma.decompress(data), name.removesuffix(".xz")
    if name.endswith(".xml"):
        return read_xml(data)
    if name.endswith(".json"):
        return read_json(data)
    raise InputError(f"{path}: expected a file name that ends in .xml, .json, .xml.xz or .json.xz")


def _fact(
    name: str, kind: str, unit: str | None, default: object, least: object, most: object, reboot: bool
) -> Fact:
    kind = kind.upper()
    if kind not in ("INT32", "FLOAT"):
        raise InputError(f"parameter {name}: got type {kind}, expected INT32 or FLOAT")
    return Fact(
        kind,
        unit or "",
        _number(kind, default),
        _number(kind, least),
        _number(kind, most),
        "1" if reboot else "",
    )


def _number(kind: str, value: object) -> str:
    if value in (None, ""):
        return ""
    number = float(str(value))
    return str(int(number)) if kind == "INT32" else f"{number:.9g}"


def _named(found: dict[str, Fact]) -> dict[str, Fact]:
    return {name: fact for name, fact in found.items() if _NAME.fullmatch(name)}


def sources(tree: Path, names: Sequence[str]) -> dict[str, str]:
    """Return {parameter name: file in PX4's folder `src` that defines the parameter}.

    Some names are not in any file, because PX4's build generates them. Such a name is found by its pattern or
    prefix.
    """
    exact: dict[str, str] = {}
    patterns: dict[str, str] = {}
    for path in sorted(tree.glob("src/**/*")):
        place = str(path.relative_to(tree / "src"))
        if path.suffix in (".c", ".h"):
            exact.update({name: place for name in _IN_C.findall(path.read_text(errors="replace"))})
        elif path.suffix == ".yaml":
            patterns.update({name: place for name in _IN_YAML.findall(path.read_text(errors="replace"))})
    shaped = [
        (re.compile(re.sub(r"\\\$\\\{\w+\\\}", r"\\w+", re.escape(text)) + r"(_\w+)?"), text, place)
        for text, place in sorted(patterns.items(), key=lambda item: -len(item[0]))
    ]  # longest pattern first
    found = {}
    for name in names:
        place = (
            exact.get(name)
            or patterns.get(name)
            or next((p for shape, _, p in shaped if shape.fullmatch(name)), "")
        )
        found[name] = place or next((p for prefix, p in _GENERATED.items() if name.startswith(prefix)), "")
    return found


def load(text: str) -> Table:
    """Parse the text of px4_parameters.csv to a `Table`."""
    of = {
        line[2:].split(" ", 1)[0]: line[2:].split(" ", 1)[1]
        for line in text.splitlines()
        if line.startswith("# ")
    }
    order = sorted(of, key=_key)
    table = Table({version: {} for version in order}, {version: {} for version in order}, of)
    for row in csv.DictReader(line for line in text.splitlines() if not line.startswith("#")):
        fact = Fact(*(row[column] for column in Fact._fields))
        for version in order[order.index(row["since"]) : order.index(row["until"]) + 1]:
            table.facts[version][row["name"]] = fact
            table.sources[version][row["name"]] = row["source"]
    return table


def dump(table: Table) -> str:
    """Return the text of px4_parameters.csv for a `Table`.

    Consecutive PX4 versions share a row if the parameter has the same properties in them.
    """
    out = io.StringIO()
    order = sorted(table.facts, key=_key)
    out.writelines(f"# {version} {table.of[version]}\n" for version in order)
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for name in sorted({name for facts in table.facts.values() for name in facts}):
        for fact, since, until in _spans(name, order, table.facts):
            writer.writerow((name, *fact, since, until, table.sources[until].get(name, "")))
    return out.getvalue()


def _spans(
    name: str, order: Sequence[str], facts: Mapping[str, Mapping[str, Fact]]
) -> Iterator[tuple[Fact, str, str]]:
    held: Fact | None = None
    since = until = ""
    for version in order:
        fact = facts[version].get(name)
        if fact != held:
            if held is not None:
                yield held, since, until
            held, since = fact, version
        until = version
    if held is not None:
        yield held, since, until


def _key(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")))


def replaced(
    table: Table, version: str, facts: dict[str, Fact], found: Mapping[str, str], of: str, over: bool
) -> Table:
    """Return a copy of the parameter table with new properties for the parameters of one PX4 version.

    facts: new parameters of the version.
    found: parameter name -> source file in PX4's tree.
    of: `=` or `~`, and the tag or commit of the version.
    over: replace or add only the parameters in `facts`; false: remove all others.
    """
    new = {**table.facts.get(version, {}), **facts} if over else facts
    known = {
        name: place
        for v in sorted(table.sources, key=_key)
        for name, place in table.sources[v].items()
        if place
    }
    here = table.sources.get(version, {})
    places = {name: found.get(name) or here.get(name) or known.get(name, "") for name in new}
    return Table({**table.facts, version: new}, {**table.sources, version: places}, {**table.of, version: of})


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m arena.params.facts.regenerate",
        description="Write px4_parameters.csv from PX4's parameter files.",
    )
    parser.add_argument(
        "place", type=Path, help="a folder with one folder per version, or one parameters.xml or .json"
    )
    parser.add_argument("--version", help="PX4 version of the file: 1.16")
    parser.add_argument("--over", action="store_true", help="replace or add only the parameters of the file")
    parser.add_argument(
        "--of",
        default="",
        help="tag or commit, such as v1.16.0; with ~ if it is not a release: '~ main of 2026-07-08'",
    )
    parser.add_argument(
        "--tree", type=Path, help="PX4's source tree of that version, for the column `source`"
    )
    parser.add_argument("--table", type=Path, default=TABLE, help="the table to rewrite")
    given = parser.parse_args(arguments)
    table = load(given.table.read_text()) if given.table.exists() else Table({}, {}, {})
    for version, files, of, tree in _inputs(given):
        facts: dict[str, Fact] = {}
        for file in files:
            facts.update(read(file))
        mark = of or table.of.get(version, "= v" + version)
        places = sources(tree, tuple(facts)) if tree else {}
        table = replaced(table, version, facts, places, mark if mark[0] in "=~" else f"= {mark}", given.over)
        print(f"PX4 {version}: read {len(facts)} parameters from {len(files)} files")
    given.table.write_text(dump(table))


def _inputs(given: argparse.Namespace) -> Iterator[tuple[str, list[Path], str, Path | None]]:
    """Yield (version, parameter files, tag or commit, PX4 source tree) for each PX4 version to read.

    given: command-line arguments. `given.place` is one parameter file, or a folder with one subfolder for each version.
    """
    if given.place.is_file():
        yield _minor(given.version or given.place.parent.name), [given.place], given.of, given.tree
        return
    folders = [f for f in sorted(given.place.iterdir()) if f.is_dir() and _MINOR.fullmatch(f.name)]
    if not folders:
        raise InputError(
            f"{given.place}: expected folders named by version (1.16), each with parameters.xml or parameters.json"
        )
    for folder in sorted(folders, key=lambda f: _key(_minor(f.name))):
        files = sorted(f for f in folder.iterdir() if re.search(r"\.(xml|json)(\.xz)?$", f.name))
        of, tree = (folder / "of.txt", folder / "tree.txt")
        yield (
            _minor(folder.name),
            files,
            of.read_text().strip() if of.exists() else "",
            Path(tree.read_text().strip()) if tree.exists() else None,
        )


def _minor(text: str) -> str:
    found = _MINOR.fullmatch(text)
    if found is None:
        raise InputError(
            f"{text!r} is not a version. Give the PX4 version of the file, for example --version 1.16"
        )
    return found[1]


if __name__ == "__main__":
    main()
