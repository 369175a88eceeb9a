"""Tests of the table of failsafe actions and delays."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from arena.errors import InputError
from arena.params.facts import failsafe_table
from arena.params.facts.failsafe_table import Action, Event, delays
from arena.params.facts.parameter_table import parameters, versions
from arena.schema.px4 import find_px4


def minor(text: str) -> int:
    return int(text.split(".")[1])


def px4_build() -> tuple[str, Path]:
    """Return (version, parameters.xml) of the installed PX4, or skip."""
    found = find_px4()
    build = Path(found.data).parent / "parameters.xml" if found and not found.stand_in else None
    if found is None or build is None or not build.exists():
        pytest.skip("no PX4 build with a parameters.xml found: set PX4_HOME")
    return found.version, build


@pytest.mark.px4
def test_installed_px4_describes_the_values_alike() -> None:
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
    compared = 0
    for event in failsafe_table.EVENTS:
        for action in failsafe_table.supported_actions(event, version):
            for name, value in failsafe_table.settings_for(event, action, version).items():
                if (name, value) in labels:
                    compared += 1
                    assert any(word in labels[name, value] for word in (action, *also.get(action, ()))), (
                        event,
                        action,
                        name,
                    )
    assert compared > 20


BEYOND = {"COM_ACT_FAIL_ACT"}
"""PX4's maximum excludes an action that PX4 documents and takes."""


@pytest.mark.parametrize("version", [str(v) for v in versions()])
@pytest.mark.parametrize("event", failsafe_table.EVENTS)
def test_every_action_uses_parameters_of_its_version(event: Event, version: str) -> None:
    assert (
        sum(r.event == event and r.since <= minor(version) <= r.until for r in failsafe_table.all_actions())
        == 1
    )
    known, found = parameters(version), failsafe_table.failsafe_actions(event, version)
    assert found.settings and found.note and found.source
    for action in failsafe_table.supported_actions(event, version):
        for name, value in failsafe_table.settings_for(event, action, version).items():
            p = known[name]
            within = (p.min is None or value >= p.min) and (p.max is None or value <= p.max)
            assert within or name in BEYOND, (action, name)
    for delay in delays(event, version):
        assert delay.parameter in known


@pytest.mark.parametrize("version", [str(v) for v in versions()])
@pytest.mark.parametrize("event", failsafe_table.EVENTS)
def test_actions_are_recognised_from_their_values(event: Event, version: str) -> None:
    for action in failsafe_table.supported_actions(event, version):
        found = failsafe_table.settings_for(event, action, version)
        if found:
            assert failsafe_table.selected_action(event, found, version) == action


def test_land_has_another_number_in_another_version() -> None:
    assert failsafe_table.settings_for("offboard_loss_without_rc", "land", "1.9") == {"COM_OBL_ACT": 0}
    assert failsafe_table.settings_for("offboard_loss_without_rc", "land", "1.13") == {"COM_OBL_ACT": 0}
    assert failsafe_table.settings_for("offboard_loss_without_rc", "land", "1.16") == {"COM_OBL_RC_ACT": 4}
    assert failsafe_table.selected_action("offboard_loss", {"COM_OBL_RC_ACT": -1}, "1.13") == "none"
    assert failsafe_table.selected_action("offboard_loss", {"COM_OBL_RC_ACT": -1}, "1.16") is None


@pytest.mark.parametrize(
    ("event", "action", "version", "why"),
    [
        ("offboard_loss", "none", "1.16", "-1 .none. was removed"),
        ("offboard_loss_without_rc", "disarm", "1.9", "COM_OBL_ACT has"),
        ("rc_loss_in_offboard", "land", "1.12", "ignores RC"),
        ("data_link_loss_in_offboard", "land", "1.13", "ignores the data link"),
        ("position_loss_in_offboard", "hold", "1.16", "become descend"),
        ("position_loss_in_position_mode", "descend", "1.17", "COM_POSCTL_NAVL was removed"),
        ("geofence", "land", "1.10", "land was added in 1.11"),
        ("attitude_failure", "terminate", "1.9", "does not enforce"),
    ],
)
def test_action_that_a_version_lacks_is_refused_with_the_reason(
    event: Event, action: Action, version: str, why: str
) -> None:
    with pytest.raises(InputError, match=why):
        failsafe_table.settings_for(event, action, version)


def test_rc_input_mode_follows_the_version() -> None:
    assert [failsafe_table.rc_input_mode("none", v) for v in ("1.9", "1.12", "1.13", "1.18")] == [1, 1, 4, 4]
    assert failsafe_table.rc_input_mode("radio", "1.9") == failsafe_table.rc_input_mode("radio", "1.18") == 0
    with pytest.raises(InputError, match="radio, joystick, none"):
        failsafe_table.rc_input_mode("both", "1.12")


def test_delays_are_in_seconds() -> None:
    (first, *_) = delays("position_loss_in_offboard", "1.16")
    assert parameters("1.16")[first.parameter].default * first.scale_s == pytest.approx(5.0)
    assert [(d.parameter, d.fixed_s) for d in delays("offboard_loss", "1.9")] == [("COM_OF_LOSS_T", 0.5)]
    assert [(d.parameter, d.fixed_s) for d in delays("offboard_loss", "1.16")] == [("COM_OF_LOSS_T", 0.0)]
    assert [d.parameter for d in delays("low_battery", "1.16")] == ["COM_FAIL_ACT_T"]
