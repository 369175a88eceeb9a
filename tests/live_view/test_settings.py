"""Settings of viewers, read from the slice that the plan makes."""

import pytest

from arena.errors import RunError
from arena.live_view.settings import Fence, Settings
from arena.plan import make_plan
from arena.schema import load_arena

YAML = """
world: {size: [9, 5, 3], obstacles: {shelf: {size: [1, 0.5, 2], position: [3, 1, -0.2]}}}
mocap: {source: natnet, server: 127.0.0.3}
geofence: {north: [-3, 3], east: [-1.5, 1.5], up: 2}
vehicles:
  uav1: {start: {position: [0, 0, 0]}, autopilot: builtin, profile: iris}
  uav2: {start: {position: [1, 0, 0]}, autopilot: hardware, profile: iris, radio: none, url: "udpin:127.0.0.1:15000"}
"""


def slice_of(folder):
    (folder / "arena.yaml").write_text(YAML)
    return make_plan(load_arena(folder / "arena.yaml")).slices["view.json"]


def test_slice_of_the_plan_gives_room_fence_and_vehicles(tmp_path):
    settings = Settings.from_slice(slice_of(tmp_path))
    assert settings.size_m == (9.0, 5.0, 3.0)
    assert settings.fence is not None and settings.fence.north[0] >= -3.0 and settings.fence.up <= 2.0
    assert isinstance(settings.fence, Fence)
    (shelf,) = settings.obstacles
    assert (shelf.name, shelf.size_m, shelf.centre_n) == ("shelf", (1.0, 0.5, 2.0), (3.0, 1.0, -1.2))
    simulated, real = settings.vehicles
    assert (simulated.kind, simulated.index, simulated.tools) == ("simulated", 0, ("127.0.0.1", 24016))
    assert (real.kind, real.index, real.body) == ("real", None, "uav2")
    assert len(simulated.rotors) == 4 and {r.clockwise for r in simulated.rotors} == {True, False}


def test_offboard_loss_time_is_that_of_the_autopilot_of_the_vehicle(tmp_path):
    def times(text):
        (tmp_path / "arena.yaml").write_text(text)
        raw = make_plan(load_arena(tmp_path / "arena.yaml")).slices["view.json"]
        return raw, [v.offboard_loss_s for v in Settings.from_slice(raw).vehicles]

    assert times(f"{YAML}failsafe: {{offboard_loss: {{after_s: 1.5}}}}\n")[1] == [1.5, 1.5]
    raw, found = times(YAML.replace("start: {position: [1, 0, 0]}", "params: {COM_OF_LOSS_T: 2.5}"))
    assert found == [1.0, 2.5]
    del raw["vehicles"][0]["offboard_loss_s"]  # a run of an older version
    assert Settings.from_slice(raw).vehicles[0].offboard_loss_s == 1.0


def test_only_the_capture_of_real_vehicles_is_received(tmp_path):
    (capture,) = Settings.from_slice(slice_of(tmp_path)).captures
    assert (capture["server"], capture["bodies"]) == ("127.0.0.3", ["uav2"])


def test_replayed_vehicle_is_marked(tmp_path):
    raw = slice_of(tmp_path)
    raw["vehicles"][1]["replayed"] = True
    assert [v.kind for v in Settings.from_slice(raw).vehicles] == ["simulated", "replayed"]


def test_missing_key_is_named(tmp_path):
    raw = slice_of(tmp_path)
    del raw["truth"]
    with pytest.raises(RunError, match="'truth'"):
        Settings.from_slice(raw)
