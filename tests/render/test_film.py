"""Files of `arena render`: written, and read back by imageio. Logs of a run, and single logs."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from record_files import RecordFile

import arena.cli as cli
from arena.errors import RunError
from arena.render import film
from arena.render.script import make_script, picture_times
from arena.render.sources import load
from arena.render.surroundings import surroundings
from arena.render.views import View

from .synthetic import circle_flight, write_csv

ROTORS = [
    {"position_m": [x, y, -0.02], "direction": "cw"} for x, y in ((0.3, 0.0), (-0.2, 0.25), (-0.2, -0.25))
]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run folder with the logs of uav10 and uav9 (in this order in the plan), in a room of 8 m x 6 m x 3 m."""
    folder = tmp_path / "runs" / "20260101-lab"
    folder.mkdir(parents=True)
    for k, name in enumerate(("uav10", "uav9")):
        write_csv(circle_flight(name, phase=2.0 * k, seconds=6.0), folder)
    world = {"size_m": [8, 6, 3], "vehicles": [{"name": "uav9", "profile": {"rotors": ROTORS}}]}
    plan = {"name": "lab", "vehicles": [{"name": "uav10"}, {"name": "uav9"}], "slices": {"world.json": world}}
    (folder / "plan.json").write_text(json.dumps(plan))
    return folder


def render(*arguments: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = cli.main(["render", *arguments])
    said = capsys.readouterr()
    return code, said.out, said.err


def test_run_folder_gives_names_room_and_airframes(run):
    recorded = load([run])
    assert recorded.title == "lab" and [t.name for t in recorded.tracks] == ["uav10", "uav9"]
    assert (recorded.room.low, recorded.room.high, recorded.room.height_m) == ((-4, -3), (4, 3), 3)
    assert [len(t.airframe.rotors_b) for t in recorded.tracks] == [4, 3]


def test_geofence_and_rotors_of_a_real_vehicle_come_from_the_slice_of_viewers(run):
    plan = json.loads((run / "plan.json").read_text())
    view = {
        "size_m": [8, 6, 3],
        "fence": {"north": [-3, 3], "east": [-2, 2], "up": 2.5},
        "vehicles": [{"name": "uav10", "profile": "hexa", "height_m": 0.2, "rotors": ROTORS * 2}],
    }
    plan["slices"] = {"view.json": view}
    (run / "plan.json").write_text(json.dumps(plan))
    recorded = load([run])
    assert recorded.room.fence == ((-3, -2, 0), (3, 2, -2.5))
    assert len(recorded.tracks[0].airframe.rotors_b) == 6 and recorded.tracks[0].airframe.below_m == 0.1
    script = make_script(recorded, np.array([3.0]), View(), (320, 180), speed=1.0, trail_s=1.0)
    without = dataclasses.replace(recorded, room=dataclasses.replace(recorded.room, fence=None))
    plain = make_script(without, np.array([3.0]), View(), (320, 180), speed=1.0, trail_s=1.0)
    changed = np.asarray(script.picture(0), int) - np.asarray(plain.picture(0), int)
    assert (changed[..., 0] > 30).sum() > 100  # amber lines


def test_log_in_a_run_folder_gets_the_room_of_its_run(run):
    recorded = load([run / "csv" / "uav9.csv"])
    assert [t.name for t in recorded.tracks] == ["uav9"] and recorded.room.height_m == 3


def test_record_without_its_run_folder_has_the_room_and_the_order_of_its_metadata(tmp_path):
    RecordFile(tmp_path / "flight.mcap").close()
    found = surroundings(tmp_path / "flight.mcap")
    assert (found.title, found.order) == ("lab", ("uav1", "uav2"))
    assert found.room is not None and (found.room.low, found.room.height_m) == ((-4, -3), 3)


def test_single_log_gets_a_floor_around_its_flight(tmp_path):
    recorded = load([write_csv(circle_flight(), tmp_path)])
    assert recorded.title == "uav1" and recorded.room.height_m is None
    assert min(recorded.room.low) == -2 and max(recorded.room.high) == 2


def test_flights_of_different_days_start_together(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    first = write_csv(circle_flight("uav1", t0=100.0), tmp_path / "a")
    second = write_csv(circle_flight("uav2", t0=90000.0), tmp_path / "b")
    assert [t.t[0] for t in load([first, second]).tracks] == pytest.approx([0.0, 0.0])


def test_mp4_has_the_pictures_of_the_film(run, tmp_path, capsys):
    file = tmp_path / "film.mp4"
    code, out, err = render(
        str(run),
        "-o",
        str(file),
        "--size",
        "320x180",
        "--fps",
        "10",
        "--from",
        "1",
        "--to",
        "3",
        capsys=capsys,
    )
    assert code == 0 and f"film: {file} (" in out, err
    pictures = iio.imread(file)
    assert pictures.shape == (21, 180, 320, 3)
    assert iio.immeta(file)["fps"] == 10
    expected = make_script(
        load([run]), picture_times(1.0, 3.0, 10.0, 1.0), View(), (320, 180), speed=1.0, trail_s=5.0
    )
    for k in (0, 13, 20):
        error = np.abs(pictures[k].astype(int) - np.asarray(expected.picture(k), int))
        assert error.mean() < 4.0  # the codec loses little


def test_gif_plays_at_its_speed_in_one_palette(run, tmp_path, capsys):
    file = tmp_path / "film.gif"
    arguments = [
        "-o",
        str(file),
        "--size",
        "200x120",
        "--fps",
        "5",
        "--speed",
        "2",
        "--from",
        "1",
        "--to",
        "5",
    ]
    assert render(str(run), *arguments, capsys=capsys)[0] == 0
    pictures = iio.imread(file)
    assert pictures.shape[:3] == (11, 120, 200)
    assert iio.immeta(file, index=0)["duration"] == 200
    moved = np.abs(pictures[0].astype(int) - pictures[5].astype(int)).max(axis=2) > 60
    assert moved.sum() > 50
    script = make_script(
        load([run]), picture_times(1.0, 5.0, 5.0, 2.0), View(), (200, 120), speed=2.0, trail_s=5.0
    )
    error = np.abs(pictures[5][..., :3].astype(int) - np.asarray(script.picture(5), int)).max(axis=2)
    assert (
        error.mean() < 6 and np.percentile(error, 99.9) < 70
    )  # also the few pixels of the vehicles keep their colours


def test_png_shows_the_whole_flight_or_one_moment(run, tmp_path, capsys):
    whole, moment = tmp_path / "whole.png", tmp_path / "moment.png"
    assert render(str(run), "-o", str(whole), "--size", "400x300", capsys=capsys)[0] == 0
    assert render(str(run), "-o", str(moment), "--from", "3", "--vehicle", "uav9", capsys=capsys)[0] == 0
    assert iio.imread(whole).shape == (300, 400, 3) and iio.imread(moment).shape == (900, 1600, 3)


def test_folder_of_an_arena_stands_for_its_last_run(run, capsys):
    code, out, _ = render(str(run.parents[1]), "-o", str(run / "x.png"), capsys=capsys)
    assert code == 0 and out.startswith(f"picture: {run / 'x.png'} (")


def test_command_of_make_demo_writes_its_film(run, capsys):
    makefile = Path(__file__).parents[2].joinpath("Makefile").read_text()
    words = next(line.split() for line in makefile.splitlines() if "arena render" in line)
    code, out, err = render(str(run.parents[1]), *words[3:], capsys=capsys)
    assert code == 0 and out.startswith(f"film: {run / 'film.mp4'} ("), err
    assert len(iio.imread(run / "film.mp4")) == 68  # armed from 2 s to 4 s, 15 pictures per second


def test_pictures_from_several_processes_are_in_order(run):
    script = make_script(
        load([run]), picture_times(1.0, 3.0, 10.0, 1.0), View(), (96, 64), speed=1.0, trail_s=1.0
    )
    numbers = range(len(script.times))
    assert list(film.pictures(script, numbers, 3)) == list(film.pictures(script, numbers, 1))


def test_failed_film_leaves_no_file_and_keeps_the_old_one(run, tmp_path):
    file = tmp_path / "film.gif"
    file.write_text("old")
    script = make_script(
        load([run]), picture_times(1.0, 3.0, 10.0, 1.0), View(), (96, 64), speed=1.0, trail_s=1.0
    )

    def full(done: int, total: int) -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(RunError, match="No space left"):
        film.write_film(script, file, fps=10.0, jobs=1, progress=full)
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == ["film.gif"] and file.read_text() == "old"


def test_picture_that_cannot_be_written_is_reported(run, tmp_path, capsys):
    (tmp_path / "taken.png").mkdir()
    code, _, err = render(str(run), "-o", str(tmp_path / "taken.png"), capsys=capsys)
    assert code == 1 and "taken.png: could not be written" in err


def test_heading_counts_the_modes_of_many_vehicles(run):
    few = make_script(load([run]), np.array([3.0]), View(), (96, 64), speed=2.0, trail_s=1.0)
    assert few.heading(0) == ["lab", "3.0 s   2x"]
    recorded = load([run])
    many = dataclasses.replace(recorded, tracks=recorded.tracks * 3)
    crowd = make_script(many, np.array([3.0]), View(), (96, 64), speed=1.0, trail_s=1.0)
    assert crowd.heading(0)[2] == "6 OFFBOARD"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-o", "film.avi"], "expected a file name that ends with .mp4, .gif, .png"),
        (["-o", "missing/film.gif"], "the folder missing does not exist"),
        (["-o", "a.gif", "--size", "12"], "--size 12: expected width and height"),
        (["-o", "a.gif", "--size", "10x99999"], "from 64 to 7680 px"),
        (["-o", "a.gif", "--vehicle", "uav77"], "no such vehicle in"),
        (["-o", "a.gif", "--camera", "behind"], "--camera behind: expected corner"),
        (["-o", "a.gif", "--camera", "follow:x"], "expected one of uav10, uav9"),
        (["-o", "a.gif", "--from", "5", "--to", "4"], "change --from or --to"),
    ],
)
def test_wrong_argument_is_refused_with_what_is_expected(
    run, arguments, words, capsys, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    code, _, err = render(str(run), *arguments, capsys=capsys)
    assert code == 2 and words in err
    assert not list(tmp_path.glob("*.*"))


def test_path_that_does_not_exist_is_refused(tmp_path, capsys):
    code, _, err = render(str(tmp_path / "nothing"), capsys=capsys)
    assert code == 2 and "does not exist. `arena runs` lists run folders" in err


def test_missing_ffmpeg_is_reported_with_the_command_to_install_it(run, monkeypatch, capsys):
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    code, _, err = render(str(run), capsys=capsys)
    assert code == 2 and "pip install 'flying-arena[render]'" in err
