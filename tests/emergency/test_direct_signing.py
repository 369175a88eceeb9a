"""land-all's direct connection to a vehicle that signs."""

import json

import pytest
from emergency_fleet import flying
from served import Connection, Served, UdpPort
from signing_autopilot import SigningAutopilot

from arena.emergency.direct_signing import DirectSigning
from arena.emergency.land_all import land_all
from arena.emergency.targets import from_plan, from_yaml
from arena.signing_key import TimestampFile, read_key, write_new_key
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import parse_frames
from arena.wire.mavlink_signing import FrameSigner, SignatureCheck, Verdict, timestamp_at

WALL_S = 1_795_000_000.0


def made(folder, said):
    file = folder / "key"
    if not file.exists():
        write_new_key(file)
    return DirectSigning(str(file), said.append, lambda: WALL_S), file


def test_commands_are_signed_with_a_link_id_of_their_own(tmp_path) -> None:
    signing, file = made(tmp_path, [])
    signed = signing.sign(Codec(253, 190).onboard_heartbeat())
    (frame,) = parse_frames(signed).frames
    assert SignatureCheck(read_key(file)).check(signed, frame, timestamp_at(WALL_S)) is Verdict.VALID
    assert signed[-13] == 2


def test_commands_are_newer_than_those_of_the_link_process(tmp_path) -> None:
    TimestampFile(tmp_path / "key").write(timestamp_at(WALL_S + 3600.0))
    signing, _ = made(tmp_path, [])
    signed = signing.sign(Codec(253, 190).onboard_heartbeat())
    assert int.from_bytes(signed[-12:-6], "little") > timestamp_at(WALL_S + 3600.0)


def test_telemetry_without_a_valid_signature_is_not_used(tmp_path) -> None:
    said = []
    signing, file = made(tmp_path, said)
    plain = Codec(1, 1).onboard_heartbeat()
    signed = FrameSigner(read_key(file), 0).sign(plain, WALL_S)
    assert signing.accepted(plain) == b""
    assert "without a valid signature" in said[0]
    assert signing.accepted(plain + signed) == signed
    assert signing.accepted(signed) == b""


def test_unreadable_key_is_reported_and_commands_are_sent_unsigned(tmp_path) -> None:
    said = []
    _, file = made(tmp_path, said)
    file.chmod(0o640)
    signing, _ = made(tmp_path, said)
    plain = Codec(253, 190).onboard_heartbeat()
    assert signing.sign(plain) == plain == signing.accepted(plain)
    (text,) = said
    assert "mode 0640" in text and "ignores these commands" in text
    assert file.read_text().strip() not in text


def test_key_file_comes_from_the_yaml(tmp_path) -> None:
    (tmp_path / "arena.yaml").write_text(
        "vehicles:\n"
        "  uav1: {autopilot: hardware, url: 'udpin:0.0.0.0:14540', signing: {key_file: keys/uav1}}\n"
        "  uav2: {autopilot: hardware, url: 'udpin:0.0.0.0:14541'}\n"
    )
    keys = [t.direct.key_file for t in from_yaml(tmp_path / "arena.yaml").targets]
    assert keys == [str(tmp_path / "keys" / "uav1"), ""]


def test_plan_and_slice_contain_the_path_and_not_the_key(tmp_path) -> None:
    from arena.plan import make_plan
    from arena.schema import load_arena

    write_new_key(tmp_path / "uav1.key")
    (tmp_path / "arena.yaml").write_text(
        "mocap: {source: natnet, server: 10.0.0.2}\nvehicles:\n"
        "  uav1: {autopilot: hardware, profile: iris, url: 'udpin:0.0.0.0:14540', px4_version: '1.18',\n"
        "         signing: {key_file: uav1.key}}\n"
    )
    plan = make_plan(load_arena(tmp_path / "arena.yaml"))
    assert plan.slices["link.uav1.json"]["key_file"] == str(tmp_path / "uav1.key")
    assert read_key(tmp_path / "uav1.key").hex() not in plan.to_json()
    (target,) = from_plan(plan.to_json())
    assert target.direct.key_file == str(tmp_path / "uav1.key")
    (tmp_path / "again.yaml").write_text(plan.yaml)
    assert load_arena(tmp_path / "again.yaml").vehicles[0].key_file == str(tmp_path / "uav1.key")


def run_folder(folder, host, key_file):
    """Write the run folder of a real vehicle whose link process has ended."""
    (folder / "wire").mkdir(parents=True)
    wire = {"kind": "udpin", "address": [host, 14541]}
    link = {
        "autopilot_host": host,
        "autopilot_port": 24014,
        "partner_host": host,
        "partner_port": 24015,
    }
    vehicle = {
        "name": "uav1",
        "id": 1,
        "simulated": False,
        "panic": link,
        "router": link,
        "tools_port": 24016,
    }
    slice_ = {"wire": wire, "key_file": str(key_file)}
    (folder / "plan.json").write_text(
        json.dumps({"vehicles": [vehicle], "slices": {"link.uav1.json": slice_}})
    )
    seen = {"kind": "udpin", "local": [host, 14541], "vehicle": [host, 25001]}
    (folder / "wire" / "uav1.json").write_text(json.dumps(seen))
    return folder


@pytest.mark.parametrize("readable", [True, False])
def test_land_all_lands_a_signing_vehicle_without_its_link_process(tmp_path, capsys, readable):
    host, file = f"127.66.77.{1 + readable}", tmp_path / "key"
    write_new_key(file)
    board = SigningAutopilot(flying(1), read_key(file))
    file.chmod(0o600 if readable else 0o644)
    run = run_folder(tmp_path / "run", host, file)
    with Served([Connection(autopilot=board, port=UdpPort((host, 25001)), remote=(host, 14541))]):
        code = land_all(run=run, timeout_s=60.0 if readable else 3.0)
    said = capsys.readouterr().out
    assert (code == 0) is readable
    assert board.inner.armed is not readable
    assert ("ignores these commands" in said) is not readable
    assert "wrong signature" not in {v.value for v in board.refused}
