"""Golden text of the messages that users meet first: place, key, value found, value expected, what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from arena.errors import InputError
from arena.plan import make_plan
from arena.schema import load_arena

V = "vehicles:\n  uav1: "
NATNET = "mocap: {source: natnet, server: 10.0.0.2}\n"
HARDWARE = "autopilot: hardware, profile: iris, radio: none, url: 'udpin:0.0.0.0:14540'"

# what is wrong -> (YAML, every line of the error)
GOLDEN: dict[str, tuple[str, list[str]]] = {
    "typing error in a key": (
        V + "{profle: iris}\n",
        ["arena.yaml:2: vehicles.uav1.profle: unknown key. Did you mean profile?"],
    ),
    "key of the program at the vehicle": (
        V + "{program: hover.py, restart: alway}\n",
        ["arena.yaml:2: vehicles.uav1.restart: unknown key. Did you mean vehicles.uav1.program.restart?"],
    ),
    "key of a start at the vehicle": (
        V + "{position: [0, 0, 0]}\n",
        ["arena.yaml:2: vehicles.uav1.position: unknown key. Did you mean vehicles.uav1.start.position?"],
    ),
    "room without a height": (
        "world: {size: [4, 4]}\n" + V + "{}\n",
        ["arena.yaml:1: world.size: got [4, 4], expected a list of 3 numbers: north, east, height [m]."],
    ),
    "room as a text": (
        "world: {size: 4x4x3}\n" + V + "{}\n",
        ["arena.yaml:1: world.size: got '4x4x3', expected a list of 3 numbers: north, east, height [m]."],
    ),
    "text in place of the keys": (
        "just text\n",
        ["arena.yaml:1: got 'just text', expected a mapping with keys such as name, address, world, sim."],
    ),
    "planned key of a vehicle": (
        V + "{camera: front}\n",
        [
            "arena.yaml:2: vehicles.uav1.camera: camera is not available yet. "
            "Simulated vehicles have an IMU, a barometer, a magnetometer and GPS."
        ],
    ),
    "objects of the world": (
        "world: {objects: []}\n" + V + "{}\n",
        ["arena.yaml:1: world.objects: unknown key. Use `world.obstacles`."],
    ),
    "obstacle outside the room": (
        "world: {obstacles: {wall: {size: [1, 1, 1], position: [4, 0, 0]}}}\n" + V + "{}\n",
        [
            "arena.yaml:1: world.obstacles.wall.position: is outside the room: got N 4, expected -3.00 .. 3.00."
        ],
    ),
    "obstacle above the ceiling": (
        "world: {obstacles: {pole: {shape: cylinder, size: [0.2, 3], position: [1, 0, -1]}}}\n" + V + "{}\n",
        [
            "arena.yaml:1: world.obstacles.pole.position: is outside the room: its highest point is 4.00 m above the floor, "
            "the ceiling is at 3 m. Make it smaller, or lower it."
        ],
    ),
    "obstacle with the size of another shape": (
        "world: {obstacles: {ball: {shape: sphere, size: [1, 1, 1], position: [1, 0, 0]}}}\n" + V + "{}\n",
        ["arena.yaml:1: world.obstacles.ball.size: got 3 numbers, expected 1 for a sphere: diameter."],
    ),
    "obstacle at the start of a vehicle": (
        "world: {obstacles: {box: {size: [1, 1, 1], position: [0.6, 0, 0]}}}\n" + V + "{}\n",
        [
            "arena.yaml:3: vehicles.uav1.start.position: is too near to the obstacle box (arena.yaml:1): got a gap of 0.00 m, "
            "expected at least 0.05 m. Move one of them."
        ],
    ),
    "colour of an obstacle": (
        "world: {obstacles: {box: {size: [1, 1, 1], position: [2, 0, 0], colour: red}}}\n" + V + "{}\n",
        [
            "arena.yaml:1: world.obstacles.box.colour: got 'red', expected a colour such as '#8d99ae', in quotes"
        ],
    ),
    "planned autopilot": (
        V + "{autopilot: ardupilot}\n",
        ["arena.yaml:2: vehicles.uav1.autopilot: ardupilot is not available yet. Use px4 or builtin."],
    ),
    "number in the arguments of a program": (
        V + "{program: hover.py, args: [--height, 1.5]}\n",
        ["arena.yaml:2: vehicles.uav1.args[1]: got 1.5, expected text. Did you mean '1.5', in quotes?"],
    ),
    "arguments as one text": (
        V + "{program: hover.py, args: --height 1.5}\n",
        [
            "arena.yaml:2: vehicles.uav1.args: got '--height 1.5', expected a list. Did you mean [--height, '1.5']?"
        ],
    ),
    "arguments in the path of a program": (
        V + "{program: hover.py --height 1.5}\n",
        [
            "arena.yaml:2: vehicles.uav1.program: got 'hover.py --height 1.5', expected a file in FOLDER. "
            "Did you mean program: hover.py, args: [--height, '1.5']?"
        ],
    ),
    "program with a syntax error": (
        V + "{program: broken.py}\n",
        [
            "arena.yaml:2: vehicles.uav1.program: broken.py:2 is not valid Python: '(' was never closed. "
            "Correct the program."
        ],
    ),
    "program with a null byte": (
        V + "{program: binary.py}\n",
        [
            "arena.yaml:2: vehicles.uav1.program: binary.py is not valid Python: "
            "source code string cannot contain null bytes. Correct the program."
        ],
    ),
    "unknown parameter": (
        V + "{autopilot: builtin, params: {MPC_XY_PP: 1}}\n",
        [
            "arena.yaml:2: vehicles.uav1.params.MPC_XY_PP: not a parameter of any PX4 version from 1.9 to 1.18. "
            "Write MPC_XY_P if you mean this parameter."
        ],
    ),
    "parameter out of range": (
        V + "{autopilot: builtin, params: {MPC_XY_P: 99}}\n",
        [
            "arena.yaml:2: vehicles.uav1.params.MPC_XY_P: got 99, expected 0 to 2. Choose MPC_XY_P 0 to 2; the default is 0.95."
        ],
    ),
    "parameter in defaults out of range": (
        "defaults:\n  autopilot: builtin\n  params:\n    MPC_XY_P: 99\n" + V + "{}\n",
        [
            "arena.yaml:4: defaults.params.MPC_XY_P: got 99, expected 0 to 2. Choose MPC_XY_P 0 to 2; the default is 0.95."
        ],
    ),
    "unknown PX4 version": (
        NATNET + V + "{" + HARDWARE + ", px4_version: '1.99'}\n",
        ["arena.yaml:3: vehicles.uav1.px4_version: got '1.99', expected a PX4 version: "],
    ),
    "px4_version that is no version": (
        V + "{px4_version: latest}\n",
        ["arena.yaml:2: vehicles.uav1.px4_version: got 'latest', expected a PX4 version such as 1.16."],
    ),
    "mass that the rotors cannot lift": (
        V + "{mass_kg: 9}\n",
        [
            "arena.yaml:2: vehicles.uav1.mass_kg: got 9, expected less than 4.20, which is the most that the rotors lift."
        ],
    ),
    "negative mass": (
        V + "{mass_kg: -1}\n",
        ["arena.yaml:2: vehicles.uav1.mass_kg: got -1, expected more than 0."],
    ),
    "unknown sensor": (
        V + "\n    sensors:\n      imuu: {accel_noise_m_s2: 0.1}\n",
        ["arena.yaml:4: vehicles.uav1.sensors.imuu: unknown key. Did you mean imu?"],
    ),
    "unknown key of a sensor": (
        V + "{sensors: {baro: {noise: 0.1}}}\n",
        ["arena.yaml:2: vehicles.uav1.sensors.baro.noise: unknown key. Did you mean noise_m?"],
    ),
    "negative noise": (
        "defaults:\n  sensors: {baro: {noise_m: -0.1}}\n" + V + "{}\n",
        ["arena.yaml:2: vehicles.uav1.sensors.baro.noise_m: got -0.1, expected at least 0."],
    ),
    "wind at hardware": (
        NATNET + V + "{" + HARDWARE + ", wind_m_s: [1, 0, 0]}\n",
        [
            "arena.yaml:3: vehicles.uav1.wind_m_s: is for simulated vehicles, but uav1 is hardware. Remove the key."
        ],
    ),
    "old name for wind": (
        V + "{wind: [1, 0, 0]}\n",
        ["arena.yaml:2: vehicles.uav1.wind: unknown key. Did you mean wind_m_s?"],
    ),
    "tool that needs an unknown process": (
        "tools:\n  rec: {argv: [sleep], needs: [rooter]}\n" + V + "{autopilot: builtin}\n",
        [
            "arena.yaml:2: tools.rec.needs: got 'rooter', expected a process that starts before this tool. Did you mean router?"
        ],
    ),
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "hover.py").write_text("print('hover')\n")
    (tmp_path / "broken.py").write_text("import math\nprint(math.pi\n")
    (tmp_path / "binary.py").write_bytes(b"x = 1\n\x00\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", GOLDEN)
def test_message_is_the_golden_text(kind: str, folder: Path) -> None:
    text, expected = GOLDEN[kind]
    Path("arena.yaml").write_text(text)
    with pytest.raises(InputError) as raised:
        make_plan(load_arena("arena.yaml"))
    lines = [str(problem) for problem in raised.value.problems]
    assert len(lines) == len(expected)
    for line, start in zip(lines, expected, strict=True):
        assert line.startswith(start.replace("FOLDER", str(folder)))


def test_program_is_compiled_and_not_run(folder: Path) -> None:
    Path("hover.py").write_text("raise SystemExit('must not run')\n")
    Path("arena.yaml").write_text(V + "{program: hover.py}\n")
    assert load_arena("arena.yaml").vehicles[0].program is not None


def test_parameter_of_a_params_file_is_not_judged(folder: Path) -> None:
    Path("lab.params").write_text("MPC_XY_P 99\nNO_SUCH_NAME 1\n")
    Path("arena.yaml").write_text(V + "{autopilot: builtin, params_file: lab.params}\n")
    make_plan(load_arena("arena.yaml"))


def test_unknown_parameter_of_a_module_of_its_own_is_allowed_on_hardware(folder: Path) -> None:
    Path("arena.yaml").write_text(f"{NATNET}{V}{{{HARDWARE}, params: {{ZZ_MY_GAIN: 1}}}}\n")
    make_plan(load_arena("arena.yaml"))


def test_program_in_place_of_an_arena_is_named_in_one_line(tmp_path: Path) -> None:
    program = tmp_path / "hover.py"
    program.write_text("from arena.uav import UAV\n")
    with pytest.raises(
        InputError, match=r"hover\.py: is a Python program, not the YAML file of an arena"
    ) as error:
        load_arena(program)
    assert "\n" not in str(error.value) and "program: hover.py" in str(error.value)
