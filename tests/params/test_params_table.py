"""PX4's parameters by version: the facts, what became of names, and what makes a failsafe do what."""

from __future__ import annotations

import csv
import itertools
import json
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

import pytest

from arena.errors import InputError
from arena.params.facts import failsafe_actions, parameter_table, regenerate, renames
from arena.params.facts.changes import CHANGES
from arena.params.facts.failsafe_delays import delays
from arena.params.facts.parameter_table import Version, assumed, parameters, source, versions
from arena.schema.px4 import find_px4

MINORS = {version.minor: parameters(version) for version in versions()}
XML = """<parameters><version>3</version><group name="G" no_code_generation="true">
<parameter name="node.rate" default="1" type="INT32"><min>0</min></parameter></group><group name="H">
<parameter name="AA_ONE" default="{one}" type="INT32"><short_desc>words of theirs</short_desc><min>0</min><max>9</max>
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


def rows() -> list[dict[str, str]]:
    text = files("arena.params").joinpath("px4_parameters.csv").read_text()
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def minor(text: str) -> int:
    return int(text.split(".")[1])


# --- the table


def test_every_version_from_1_9_to_1_18_is_there() -> None:
    assert [str(v) for v in versions()] == [f"1.{n}" for n in range(9, 19)]


def test_spans_of_a_name_do_not_overlap_and_are_not_longer_than_they_need() -> None:
    for name, group in itertools.groupby(rows(), key=lambda row: row["name"]):
        spans = list(group)
        for first, then in itertools.pairwise(spans):
            assert minor(first["until"]) < minor(then["since"]), name
            if minor(first["until"]) + 1 == minor(then["since"]):
                assert [first[c] for c in regenerate.Fact._fields] != [
                    then[c] for c in regenerate.Fact._fields
                ], name
        assert all(minor(row["since"]) <= minor(row["until"]) for row in spans), name


def test_numbers_are_of_their_type_and_defaults_within_their_limits() -> None:
    for facts in MINORS.values():
        for p in facts.values():
            assert p.type in ("INT32", "FLOAT")
            for number in (p.default, p.min, p.max):
                assert number is None or isinstance(number, int if p.type == "INT32" else float), p
            assert len(p.name) <= 16, "MAVLink's names have 16 bytes"
            assert (p.min is None or p.default >= p.min) and (p.max is None or p.default <= p.max), p


def test_names_and_defaults_are_those_of_the_vehicles_version() -> None:
    old, new = parameters("v1.9.2"), parameters("1.16")
    for name in ("EKF2_AID_MASK", "EKF2_HGT_MODE", "COM_POSCTL_NAVL", "COM_OBL_ACT", "MPC_XY_VEL_P"):
        assert name in old, name
    for name in ("EKF2_EV_CTRL", "EKF2_HGT_REF", "COM_OBL_RC_ACT", "MPC_XY_VEL_P_ACC", "COM_FAIL_ACT_T"):
        assert name in new, name
    assert not {"EKF2_AID_MASK", "EKF2_HGT_MODE", "COM_OBL_ACT", "MPC_XY_VEL_P"} & set(new)
    assert not {"EKF2_EV_CTRL", "EKF2_HGT_REF", "MPC_XY_VEL_P_ACC", "COM_FAIL_ACT_T"} & set(old)
    assert (old["EKF2_EV_DELAY"].default, new["EKF2_EV_DELAY"].default) == (175, 0)
    assert (parameters("1.15")["EKF2_EV_CTRL"].default, new["EKF2_EV_CTRL"].default) == (15, 0)
    assert [parameters(v)["COM_OF_LOSS_T"].default for v in ("1.10", "1.11", "1.12", "1.16")] == [
        0,
        0.5,
        1,
        1,
    ]
    assert (new["EKF2_NOAID_TOUT"].unit, new["EKF2_NOAID_TOUT"].min, new["EKF2_NOAID_TOUT"].default) == (
        "us",
        500_000,
        5_000_000,
    )
    assert "COM_POSCTL_NAVL" in new and "COM_POSCTL_NAVL" not in parameters("1.17")
    assert source("EKF2_EV_CTRL", "1.16") and source("EKF2_EV_CTRL", "1.9") == ""


def test_what_is_no_release_says_so() -> None:
    assert assumed("1.18") and not any(assumed(v) for v in versions() if v.minor < 18)


@pytest.mark.parametrize("text", ["1.8", "1.19", "2.0", "1.16x", "", "main"])
def test_an_unknown_version_names_the_known_ones(text: str) -> None:
    with pytest.raises(InputError, match=r"1\.9, 1\.10, .*1\.18"):
        Version.parse(text)


def test_versions_are_ordered_as_numbers() -> None:
    assert (
        Version.parse("1.9") < Version.parse("v1.9.2") < Version.parse("1.10") < Version.parse("1.16.0-rc1")
    )
    assert (str(Version.parse("v1.9.2")), str(Version.parse("1.16"))) == ("1.9.2", "1.16")


# --- regenerating it


def test_regenerating_takes_facts_and_no_sentence_and_changes_nothing_the_second_time(tmp_path: Path) -> None:
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


def test_json_and_xml_of_one_build_are_the_same_facts(tmp_path: Path) -> None:
    assert regenerate.read_json(json.dumps(JSON).encode()) == regenerate.read_xml(XML.format(one=3).encode())


def test_one_version_is_replaced_or_laid_over_and_the_others_stay(tmp_path: Path) -> None:
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


def test_the_source_tree_says_where_a_name_is_defined(tmp_path: Path) -> None:
    (tmp_path / "src" / "a").mkdir(parents=True)
    (tmp_path / "src" / "a" / "params.c").write_text("PARAM_DEFINE_INT32(AA_ONE, 3);\n")
    (tmp_path / "src" / "a" / "module.yaml").write_text(
        "definitions:\n    BB_${i}_X:\n    AA_TWO:\n  - param_prefix: CCC\n"
    )
    made = ("AA_TWO", "BB_0_X", "CCC_MIN1")
    found = regenerate.sources(tmp_path, ["AA_ONE", *made, "DD"])
    assert found == {"AA_ONE": "a/params.c", **dict.fromkeys(made, "a/module.yaml"), "DD": ""}


def test_the_shipped_table_is_as_regenerating_writes_it() -> None:
    text = files("arena.params").joinpath("px4_parameters.csv").read_text()
    assert regenerate.dump(regenerate.load(text)) == text


def px4_build() -> tuple[str, Path]:
    """(version, its parameters.xml) of the PX4 that is here."""
    found = find_px4()
    build = Path(found.data).parent / "parameters.xml" if found and not found.stand_in else None
    if found is None or build is None or not build.exists():
        pytest.skip(
            "no PX4 with a parameters.xml beside its binary was found: set PX4_HOME to its build folder"
        )
    return found.version, build


@pytest.mark.px4
def test_the_table_is_that_of_the_px4_that_is_here() -> None:
    version, build = px4_build()
    facts = regenerate.load(files("arena.params").joinpath("px4_parameters.csv").read_text()).facts
    known, here = facts[Version.parse(version).table], regenerate.read(build)
    assert len(here) > 500
    assert {name: fact for name, fact in here.items() if known.get(name) != fact} == {}


@pytest.mark.px4
def test_px4_calls_the_values_by_the_same_words() -> None:
    version, build = px4_build()
    labels = {
        (node.attrib["name"], float(value.attrib["code"])): (value.text or "").lower()
        for node in ElementTree.parse(build).iter("parameter")
        for value in node.iter("value")
    }
    also = {
        "none": ("disabled",),
        "stabilized": ("manual",),
        "warn": (),
        "descend": ("land",),
        "disarm": ("lockdown",),
    }
    told = 0
    for event in failsafe_actions.EVENTS:
        for action in failsafe_actions.actions(event, version):
            for name, value in failsafe_actions.ways(event, action, version).items():
                if (name, value) in labels:
                    told += 1
                    assert any(word in labels[name, value] for word in (action, *also.get(action, ()))), (
                        event,
                        action,
                        name,
                    )
    assert told > 20


# --- what became of names


@pytest.mark.parametrize("change", CHANGES, ids=lambda c: f"{c.old}-{c.at}")
def test_a_change_is_one_that_the_table_shows(change: renames.Change) -> None:
    before, after = MINORS[change.at - 1], MINORS[change.at]
    assert change.old in before
    assert (change.old in after) == change.lingers
    assert set(change.new) <= set(after)
    assert change.why and change.source
    if change.convert is not None:
        for value in {before[change.old].default, 0, 1, 2, 3}:
            assert set(change.convert(value)) <= set(change.new)


def test_the_vision_of_a_1_9_vehicle_is_carried_to_1_16() -> None:
    carried = renames.carry({"EKF2_AID_MASK": 24, "EKF2_HGT_MODE": 3, "EKF2_EV_DELAY": 20}, "1.9", "1.16")
    wanted = {
        "EKF2_EV_CTRL": 11,
        "EKF2_GPS_CTRL": 0,
        "EKF2_HGT_REF": 3,
        "EKF2_BARO_CTRL": 0,
        "EKF2_EV_DELAY": 20,
    }
    assert {name: carried.values[name] for name in wanted} == wanted
    assert set(carried.values) <= set(parameters("1.16"))
    assert any("EKF2_AID_MASK 24 becomes EKF2_EV_CTRL 11" in note for note in carried.notes)


def test_what_is_lost_is_told() -> None:
    carried = renames.carry({"COM_POSCTL_NAVL": 1, "COM_RC_IN_MODE": 1, "SENS_BOARD_ROT": 26}, "1.9", "1.17")
    assert carried.values == {}
    assert len(carried.notes) == 3 and all("is dropped" in note for note in carried.notes)


def test_what_stands_under_the_new_name_stays() -> None:
    carried = renames.carry({"COM_OBL_ACT": 0, "COM_OBL_RC_ACT": 5}, "1.13", "1.14")
    assert carried.values == {"COM_OBL_RC_ACT": 5}
    assert any("COM_OBL_RC_ACT stays 5" in note for note in carried.notes)


def test_numbers_change_with_their_meaning() -> None:
    assert renames.carry({"COM_OBL_ACT": 0}, "1.9", "1.16").values == {"COM_OBL_RC_ACT": 4}
    assert renames.carry({"NAV_RCL_ACT": 0}, "1.11", "1.12").values == {"COM_RCL_EXCEPT": 7}
    assert renames.carry({"MPC_XY_VEL_P": 0.09}, "1.10", "1.11").values["MPC_XY_VEL_P_ACC"] == pytest.approx(
        1.8
    )
    assert renames.carry({"SENS_BOARD_ROT": 4}, "1.9", "1.16").values == {"SENS_BOARD_ROT": 4}


def test_successors_run_through_the_versions_and_not_backwards() -> None:
    assert renames.successors("EKF2_HGT_MODE", "1.9", "1.16") == (
        "EKF2_HGT_REF",
        "EKF2_BARO_CTRL",
        "EKF2_RNG_CTRL",
    )
    assert renames.successors("BAT_N_CELLS", "1.9", "1.12") == ("BAT1_N_CELLS",)
    assert renames.successors("COM_POSCTL_NAVL", "1.16", "1.17") == ()
    assert renames.successors("MPC_XY_P", "1.9", "1.18") == ("MPC_XY_P",)
    with pytest.raises(InputError, match="cannot be carried back"):
        renames.carry({}, "1.16", "1.9")


# --- what makes a failsafe do what

BEYOND = {"COM_ACT_FAIL_ACT"}
"""PX4's own maximum excludes an action that it lists and obeys."""


@pytest.mark.parametrize("version", [str(v) for v in versions()])
@pytest.mark.parametrize("event", failsafe_actions.EVENTS)
def test_each_way_is_one_the_version_has_parameters_for(event: failsafe_actions.Event, version: str) -> None:
    assert sum(r.event == event and r.since <= minor(version) <= r.until for r in failsafe_actions.ROWS) == 1
    known, found = parameters(version), failsafe_actions.row(event, version)
    assert found.ways and found.why and found.source
    for action in failsafe_actions.actions(event, version):
        for name, value in failsafe_actions.ways(event, action, version).items():
            p = known[name]
            within = (p.min is None or value >= p.min) and (p.max is None or value <= p.max)
            assert within or name in BEYOND, (action, name)
    for delay in delays(event, version):
        assert delay.parameter in known


@pytest.mark.parametrize("version", [str(v) for v in versions()])
@pytest.mark.parametrize("event", failsafe_actions.EVENTS)
def test_ways_differ_and_are_read_back(event: failsafe_actions.Event, version: str) -> None:
    for action in failsafe_actions.actions(event, version):
        found = failsafe_actions.ways(event, action, version)
        if found:
            assert failsafe_actions.action_of(event, found, version) == action


def test_landing_when_the_program_ends_is_another_number_in_another_version() -> None:
    assert failsafe_actions.ways("offboard_loss_without_sticks", "land", "1.9") == {"COM_OBL_ACT": 0}
    assert failsafe_actions.ways("offboard_loss_without_sticks", "land", "1.13") == {"COM_OBL_ACT": 0}
    assert failsafe_actions.ways("offboard_loss_without_sticks", "land", "1.16") == {"COM_OBL_RC_ACT": 4}
    assert failsafe_actions.action_of("offboard_loss", {"COM_OBL_RC_ACT": -1}, "1.13") == "none"
    assert failsafe_actions.action_of("offboard_loss", {"COM_OBL_RC_ACT": -1}, "1.16") is None


@pytest.mark.parametrize(
    ("event", "action", "version", "why"),
    [
        ("offboard_loss", "none", "1.16", "-1 went"),
        ("offboard_loss_without_sticks", "disarm", "1.9", "COM_OBL_ACT knows"),
        ("sticks_loss_in_offboard", "land", "1.12", "looks at no sticks"),
        ("data_link_loss_in_offboard", "land", "1.13", "does not look at the data link"),
        ("position_loss_in_offboard", "hold", "1.16", "become descend"),
        ("position_loss_in_position_mode", "descend", "1.17", "COM_POSCTL_NAVL went"),
        ("geofence", "land", "1.10", "land came with 1.11"),
        ("attitude_failure", "terminate", "1.9", "does not"),
    ],
)
def test_what_a_version_cannot_do_is_refused_with_the_reason(
    event: failsafe_actions.Event, action: failsafe_actions.Action, version: str, why: str
) -> None:
    with pytest.raises(InputError, match=why):
        failsafe_actions.ways(event, action, version)


def test_where_sticks_come_from_has_a_number_in_each_version() -> None:
    assert [failsafe_actions.sticks("none", v) for v in ("1.9", "1.12", "1.13", "1.18")] == [1, 1, 4, 4]
    assert failsafe_actions.sticks("radio", "1.9") == failsafe_actions.sticks("radio", "1.18") == 0
    with pytest.raises(InputError, match="radio, joystick, none"):
        failsafe_actions.sticks("both", "1.12")


def test_the_waits_are_in_seconds() -> None:
    (first, *_) = delays("position_loss_in_offboard", "1.16")
    assert parameters("1.16")[first.parameter].default * first.scale == pytest.approx(5.0)
    assert [(d.parameter, d.fixed_s) for d in delays("offboard_loss", "1.9")] == [("COM_OF_LOSS_T", 0.5)]
    assert [(d.parameter, d.fixed_s) for d in delays("offboard_loss", "1.16")] == [("COM_OF_LOSS_T", 0.0)]
    assert [d.parameter for d in delays("low_battery", "1.16")] == ["COM_FAIL_ACT_T"]


def test_the_table_is_read_once() -> None:
    assert parameters("1.16") is parameters(Version(1, 16, 2))
    assert parameter_table.parameters("1.9") is not parameters("1.16")
