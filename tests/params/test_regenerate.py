"""Tests of the writer of px4_parameters.csv."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path

import pytest

from arena.params.facts import regenerate
from arena.params.facts.parameter_table import Version
from arena.schema.px4 import find_px4

XML = """<parameters><version>3</version><group name="G" no_code_generation="true">
<parameter name="node.rate" default="1" type="INT32"><min>0</min></parameter></group><group name="H">
<parameter name="AA_ONE" default="{one}" type="INT32"><short_desc>a sentence of PX4</short_desc><min>0</min><max>9</max>
<unit>s</unit><reboot_required>True</reboot_required></parameter>
<parameter name="AA_TWO" default="0.50" type="FLOAT"><long_desc>more, with a comma</long_desc><max>1e3</max>
<reboot_required>false</reboot_required></parameter></group></parameters>"""
JSON = {
    "version": 1,
    "parameters": [
        {
            "name": "AA_ONE",
            "type": "Int32",
            "default": 3,
            "min": 0,
            "max": 9,
            "units": "s",
            "rebootRequired": True,
        },
        {"name": "AA_TWO", "type": "Float", "default": 0.5, "max": 1000.0},
        {"name": "node.rate", "type": "Int32", "default": 1},
    ],
}


def test_regenerating_twice_changes_nothing(tmp_path: Path) -> None:
    made = tmp_path / "table.csv"
    for version, one in (("1.9", 3), ("1.10", 3), ("1.11", 4)):
        (tmp_path / version).mkdir()
        (tmp_path / version / "parameters.xml").write_text(XML.format(one=one))
    (tmp_path / "1.11" / "of.txt").write_text("~ main")
    regenerate.main([str(tmp_path), "--table", str(made)])
    first = made.read_text()
    assert first.splitlines() == [
        "# 1.9 = v1.9",
        "# 1.10 = v1.10",
        "# 1.11 ~ main",
        "name,type,unit,default,min,max,reboot,since,until,source",
        "AA_ONE,INT32,s,3,0,9,1,1.9,1.10,",
        "AA_ONE,INT32,s,4,0,9,1,1.11,1.11,",
        "AA_TWO,FLOAT,,0.5,,1000,,1.9,1.11,",
    ]
    regenerate.main([str(tmp_path), "--table", str(made)])
    assert made.read_text() == first


def test_json_and_xml_of_one_build_are_equal() -> None:
    assert regenerate.read_json(json.dumps(JSON).encode()) == regenerate.read_xml(XML.format(one=3).encode())


def test_one_version_is_replaced_or_merged(tmp_path: Path) -> None:
    made, build = tmp_path / "table.csv", tmp_path / "parameters.json"
    (tmp_path / "v1.9.2").mkdir()
    (tmp_path / "v1.9.2" / "parameters.xml").write_text(XML.format(one=3))
    regenerate.main([str(tmp_path), "--table", str(made), "--of", "v1.9.2"])
    build.write_text(json.dumps({"parameters": [{"name": "AA_ONE", "type": "Int32", "default": 5}]}))
    regenerate.main([str(build), "--version", "1.10", "--table", str(made)])
    regenerate.main([str(build), "--version", "1.9", "--over", "--table", str(made)])
    facts = regenerate.load(made.read_text()).facts
    assert {v: {n: f.default for n, f in of.items()} for v, of in facts.items()} == {
        "1.9": {"AA_ONE": "5", "AA_TWO": "0.5"},
        "1.10": {"AA_ONE": "5"},
    }


def test_source_file_is_found_in_the_tree(tmp_path: Path) -> None:
    (tmp_path / "src" / "a").mkdir(parents=True)
    (tmp_path / "src" / "a" / "params.c").write_text("PARAM_DEFINE_INT32(AA_ONE, 3);\n")
    (tmp_path / "src" / "a" / "module.yaml").write_text(
        "definitions:\n    BB_${i}_X:\n    AA_TWO:\n  - param_prefix: CCC\n"
    )
    made = ("AA_TWO", "BB_0_X", "CCC_MIN1")
    found = regenerate.sources(tmp_path, ["AA_ONE", *made, "DD"])
    assert found == {"AA_ONE": "a/params.c", **dict.fromkeys(made, "a/module.yaml"), "DD": ""}


def test_shipped_table_is_unchanged_by_load_and_dump() -> None:
    text = files("arena.params.facts").joinpath("px4_parameters.csv").read_text()
    assert regenerate.dump(regenerate.load(text)) == text


def px4_build() -> tuple[str, Path]:
    """Return (version, parameters.xml) of the installed PX4, or skip."""
    found = find_px4()
    build = Path(found.data).parent / "parameters.xml" if found and not found.stand_in else None
    if found is None or build is None or not build.exists():
        pytest.skip("no PX4 build with a parameters.xml found: set PX4_HOME")
    return found.version, build


@pytest.mark.px4
def test_shipped_table_matches_the_installed_px4() -> None:
    version, build = px4_build()
    facts = regenerate.load(files("arena.params.facts").joinpath("px4_parameters.csv").read_text()).facts
    known, here = facts[Version.parse(version).table], regenerate.read(build)
    assert len(here) > 500
    assert {name: fact for name, fact in here.items() if known.get(name) != fact} == {}
