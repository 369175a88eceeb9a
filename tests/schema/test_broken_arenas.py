"""Every kind of broken arena.yaml gives one clear line, with its place, and exit code 2."""

# ruff: noqa: E501  a row of the table is read as a whole

from __future__ import annotations

from pathlib import Path

import pytest

from arena.errors import InputError
from arena.plan import make_plan
from arena.schema import load_arena

V1 = "  uav1: {program: hover.py}\n"
NATNET = "mocap: {source: natnet, server: 10.0.0.2}\nvehicles:\n"

# name of the breakage -> (the YAML, `line: field: ` it must be told at, words it must hold)
REAL = "autopilot: hardware, profile: iris, url: 'udpin:0.0.0.0:14540'"
BROKEN: dict[str, tuple[str, str, str]] = {
    "unknown key of the arena": ("nme: x\nvehicles:\n" + V1, "1: nme: ", "unknown key. Did you mean name?"),
    "unknown key of a vehicle": (
        "vehicles:\n  uav1: {profle: iris}\n",
        "2: vehicles.uav1.profle: ",
        "Did you mean profile?",
    ),
    "unknown key deep inside": (
        "world:\n  origin:\n    lat: 1\nvehicles:\n" + V1,
        "3: world.origin.lat: ",
        "lat_deg",
    ),
    "duplicate key": ("name: a\nvehicles:\n" + V1 + "name: b\n", "4: name: ", "twice, on lines 1 and 4"),
    "duplicate vehicle": ("vehicles:\n" + V1 + V1, "3: vehicles.uav1: ", "twice, on lines 2 and 3"),
    "duplicate key in flow": ("vehicles:\n  uav1: {id: 1, id: 2}\n", "2: vehicles.uav1.id: ", "twice"),
    "duplicate id": (
        "vehicles:\n  uav1: {id: 3}\n  uav2: {id: 3, start: {position: [2, 0, 0]}}\n",
        "3: vehicles.uav2.id: ",
        "got 3, which uav1 (arena.yaml:2) has too. Try 1.",
    ),
    "latency that EKF2 cannot compensate": (
        "mocap: {latency_ms: 400}\nvehicles:\n" + V1,
        "1: mocap.latency_ms: ",
        "got 400, expected at most 299 ms",
    ),
    "duplicate port": (
        "vehicles:\n  uav1: {port: 17000}\n  uav2: {port: 17000, start: {position: [2, 0, 0]}}\n",
        "3: vehicles.uav2.port: ",
        "port 17000 for uav2's program is also uav1's program (arena.yaml:2)",
    ),
    "port that is another's by rule": (
        "vehicles:\n  uav1: {port: 16002}\n  uav2: {start: {position: [2, 0, 0]}}\n",
        "2: vehicles.uav1.port: ",
        "uav2's program",
    ),
    "port that is another's SDK port": (
        "vehicles:\n  uav1: {}\n  uav2: {port: 22001, start: {position: [2, 0, 0]}}\n",
        "3: vehicles.uav2.port: ",
        "uav1's SDK",
    ),
    "port of a link": ("vehicles:\n  uav1:\n    port: 24010\n", "3: vehicles.uav1.port: ", "port 24010"),
    "port of the ground stations": (
        "vehicles:\n  uav1: {port: 14550}\n",
        "2: vehicles.uav1.port: ",
        "a ground station's",
    ),
    "port whose SDK port does not exist": (
        "vehicles:\n  uav1: {port: 60000}\n",
        "2: vehicles.uav1.port: ",
        "at most 59535",
    ),
    "capture port of a link": (
        "mocap: {command_port: 24010}\nvehicles:\n" + V1,
        "1: mocap.command_port: ",
        "uav1's router link of the autopilot",
    ),
    "text for a number": (
        "sim:\n  sensor_hz: fast\nvehicles:\n" + V1,
        "2: sim.sensor_hz: ",
        "got 'fast', expected an integer",
    ),
    "number for text": ("name: 12\nvehicles:\n" + V1, "1: name: ", "got 12, expected text"),
    "fraction for a whole number": (
        "vehicles:\n  uav1: {id: 1.5}\n",
        "2: vehicles.uav1.id: ",
        "an integer",
    ),
    "no for false": (
        "vehicles:\n  uav1: {forward: no}\n",
        "2: vehicles.uav1.forward: ",
        "got 'no', expected true or false",
    ),
    "scalar for a mapping": (
        "vehicles:\n  uav1: iris\n",
        "2: vehicles.uav1: ",
        "a mapping with keys such as profile",
    ),
    "list of vehicles": ("vehicles:\n  - uav1\n", "1: vehicles: ", "a mapping of names"),
    "list for the arena": ("- a\n", "1: ", "a mapping with keys such as name"),
    "too short a position": (
        "vehicles:\n  uav1:\n    start:\n      position: [0, 0]\n",
        "4: vehicles.uav1.start.position",
        "a list of 3",
    ),
    "too long a position": (
        "vehicles:\n  uav1: {start: {position: [0, 0, 0, 0]}}\n",
        "2: vehicles.uav1.start.position",
        "of 3",
    ),
    "NaN": (
        "vehicles:\n  uav1: {start: {position: [.nan, 0, 0]}}\n",
        "2: vehicles.uav1.start.position[0]: ",
        "got .nan",
    ),
    "infinity": (
        "mocap: {latency_ms: .inf}\nvehicles:\n" + V1,
        "1: mocap.latency_ms: ",
        "got .inf, expected a finite number",
    ),
    "NaN parameter": (
        "vehicles:\n  uav1:\n    params: {MC_ROLL_P: .nan}\n",
        "3: vehicles.uav1.params.MC_ROLL_P: ",
        "finite",
    ),
    "parameter that is no PX4 name": (
        "vehicles:\n  uav1: {params: {mc_roll_p: 1}}\n",
        "2: vehicles.uav1.params.mc_roll_p: ",
        "Try MC_ROLL_P",
    ),
    "parameter against the id": (
        "vehicles:\n  uav1: {params: {MAV_SYS_ID: 9}}\n",
        "2: vehicles.uav1.params.MAV_SYS_ID: ",
        "Write `id`",
    ),
    "missing program": (
        "vehicles:\n  uav1: {program: hovr.py}\n",
        "2: vehicles.uav1.program: ",
        "Did you mean hover.py?",
    ),
    "program that cannot be run": (
        "vehicles:\n  uav1: {program: notes.txt}\n",
        "2: vehicles.uav1.program: ",
        "chmod +x",
    ),
    "program of a wrong type": (
        "vehicles:\n  uav1: {program: 3}\n",
        "2: vehicles.uav1.program: ",
        "the path of a program, or a mapping",
    ),
    "arguments without a program": (
        "vehicles:\n  uav1: {args: [x]}\n",
        "2: vehicles.uav1.args: ",
        "Add `program`",
    ),
    "unknown profile": (
        "vehicles:\n  uav1:\n    profile: irsi\n",
        "3: vehicles.uav1.profile: ",
        "Did you mean iris?",
    ),
    "unknown profile in defaults": (
        "defaults: {profile: aero}\nvehicles:\n" + V1,
        "1: defaults.profile: ",
        "Did you mean intel_aero?",
    ),
    "start outside the room": (
        "vehicles:\n  uav1: {start: {position: [3.4, 0, 0]}}\n",
        "2: vehicles.uav1.start.position: ",
        "outside the room: got N 3.4",
    ),
    "start through the other wall": (
        "vehicles:\n  uav1: {start: {position: [0, -1.9, 0]}}\n",
        "2: ",
        "got E -1.9",
    ),
    "start above the ceiling": (
        "vehicles:\n  uav1: {start: {position: [0, 0, -3]}}\n",
        "2: ",
        "outside the room: got D -3",
    ),
    "start below the floor": (
        "vehicles:\n  uav1: {start: {position: [0, 0, 1]}}\n",
        "2: ",
        "below the floor: got D 1",
    ),
    "overlapping vehicles": (
        "vehicles:\n  uav1: {}\n  uav2: {start: {position: [0.5, 0, 0]}}\n",
        "3: vehicles.uav2.start.position: ",
        "overlaps uav1 (arena.yaml:2): got 0.50 m between their centres, expected at least 0.55 m",
    ),
    "overlapping by default": (
        "vehicles:\n  uav1: {}\n  uav2: {}\n",
        "3: vehicles.uav2.start.position: ",
        "overlaps uav1",
    ),
    "pose rate that does not divide": (
        "vehicles:\n  uav1:\n    pose_rate_hz: 70\n",
        "3: vehicles.uav1.pose_rate_hz: ",
        "got 70, must divide mocap.rate_hz (180). Try 60 or 90.",
    ),
    "pose rate in defaults that does not divide": (
        "defaults:\n  pose_rate_hz: 50\nvehicles:\n" + V1,
        "2: vehicles.uav1.pose_rate_hz: ",
        "Try 45 or 60.",
    ),
    "pose rate above the frame rate": (
        "vehicles:\n  uav1: {pose_rate_hz: 200}\n",
        "2: vehicles.uav1.pose_rate_hz: ",
        "Try 180.",
    ),
    "pose rate too low to fuse": (
        "vehicles:\n  uav1: {pose_rate_hz: 4}\n",
        "2: vehicles.uav1.pose_rate_hz: ",
        "at least 10",
    ),
    "sensor rate that does not divide": (
        "sim: {sensor_hz: 240}\nvehicles:\n" + V1,
        "1: sim.sensor_hz: ",
        "Try 250.",
    ),
    "latency shorter than a step": (
        "mocap: {latency_ms: 2}\nvehicles:\n" + V1,
        "1: mocap.latency_ms: ",
        "one sensor step (4 ms",
    ),
    "speed of zero": (
        "sim: {speed: 0}\nvehicles:\n" + V1,
        "1: sim.speed: ",
        "a number above 0 and at most 1000, or max",
    ),
    "negative size": (
        "world: {size: [7, -4, 3]}\nvehicles:\n" + V1,
        "1: world.size[1]: ",
        "got -4, expected more than 0",
    ),
    "id out of range": ("vehicles:\n  uav1: {id: 250}\n", "2: vehicles.uav1.id: ", "at most 249"),
    "a host name for an address": (
        "address: localhost\nvehicles:\n" + V1,
        "1: address: ",
        "a numeric IPv4 address",
    ),
    "a host name for a ground station": (
        "vehicles:\n  uav1: {gcs: [laptop]}\n",
        "2: vehicles.uav1.gcs[0]: ",
        "numeric IPv4",
    ),
    "the arena as its own ground station": (
        "vehicles:\n  uav1: {gcs: [127.0.0.1]}\n",
        "2: vehicles.uav1.gcs[0]: ",
        "Remove it",
    ),
    "a group that is not multicast": (
        "mocap: {group: 10.0.0.1}\nvehicles:\n" + V1,
        "1: mocap.group: ",
        "Try 239.255.42.99",
    ),
    "name with a dash": ("vehicles:\n  Uav-1: {}\n", "2: vehicles.Uav-1: ", "Try uav_1."),
    "number for a name": ("vehicles:\n  1: {}\n", "2: vehicles: ", "got the key '1', expected text"),
    "unknown neighbour": (
        "vehicles:\n  uav1: {neighbours: [uav3]}\n",
        "2: vehicles.uav1.neighbours[0]: ",
        "Did you mean uav1?",
    ),
    "itself as a neighbour": (
        "vehicles:\n  uav1: {neighbours: [uav1]}\n",
        "2: vehicles.uav1.neighbours[0]: ",
        "itself",
    ),
    "unknown neighbour in a mapping": (
        "vehicles:\n  uav1:\n    neighbours:\n      vehicles: [uav3]\n",
        "4: vehicles.uav1.neighbours.vehicles[0]: ",
        "Did you mean uav1?",
    ),
    "neighbour given twice": (
        "vehicles:\n  uav1: {neighbours: [uav2, uav2]}\n  uav2: {start: {position: [2, 0, 0]}}\n",
        "2: vehicles.uav1.neighbours[1]: ",
        "a second time",
    ),
    "neighbours as a name": (
        "vehicles:\n  uav1: {neighbours: uav2}\n",
        "2: vehicles.uav1.neighbours: ",
        "list",
    ),
    "sensor without beacons": (
        "vehicles:\n  uav1: {beacon_sensor: {}}\n",
        "2: vehicles.uav1.beacon_sensor: ",
        "no beacons",
    ),
    "unknown beacon": (
        "beacons: {door: [3, 0, -2]}\nvehicles:\n  uav1: {beacon_sensor: {beacons: [dor]}}\n",
        "3: vehicles.uav1.beacon_sensor.beacons[0]: ",
        "Did you mean door?",
    ),
    "beacon with a strange name": (
        "beacons: {the door: [3, 0, -2]}\nvehicles:\n" + V1,
        "1: beacons.the door: ",
        "Rename it",
    ),
    "sensor faster than motion capture": (
        "mocap: {rate_hz: 100}\nvehicles:\n  uav1: {neighbours: {rate_hz: 120, vehicles: [uav2]}}\n"
        "  uav2: {start: {position: [2, 0, 0]}}\n",
        "3: vehicles.uav1.neighbours.rate_hz: ",
        "Try 100",
    ),
    "estimates with another origin": (
        "vehicles:\n  uav1: {neighbours: {source: estimator, vehicles: [uav2]}}\n"
        "  uav2: {forward: false, start: {position: [2, 0, 0]}}\n",
        "2: vehicles.uav1.neighbours.source: ",
        "Try mocap",
    ),
    "two vehicles on one body": (
        "vehicles:\n  uav1: {}\n  uav2: {mocap_body: uav1, start: {position: [2, 0, 0]}}\n",
        "3: vehicles.uav2.mocap_body: ",
        "also the body of uav1 (arena.yaml:2)",
    ),
    "autopilot that does not exist": (
        "vehicles:\n  uav1: {autopilot: buitlin}\n",
        "2: vehicles.uav1.autopilot: ",
        "Did you mean builtin?",
    ),
    "autopilot px4": (
        "vehicles:\n  uav1: {autopilot: px4}\n",
        "2: vehicles.uav1.autopilot: ",
        "got px4, but no PX4 was found on this machine. Try autopilot: builtin",
    ),
    "autopilot hardware": (
        "defaults: {autopilot: hardware, profile: iris}\nvehicles:\n" + V1,
        "1: vehicles.uav1.autopilot: ",
        "got hardware, which needs `url`",
    ),
    "autopilot hitl": (
        "vehicles:\n  uav1: {autopilot: hitl}\n",
        "2: vehicles.uav1.autopilot: ",
        "got hitl, which needs `serial`",
    ),
    "hardware without a profile": (  # review fault 12
        NATNET + "  uav1: {autopilot: hardware, url: 'udpin:0.0.0.0:14540'}\n",
        "3: vehicles.uav1.autopilot: ",
        "which needs `profile`: the mass, size and thrust of this vehicle. Write intel_aero, iris, or the path",
    ),
    "radio of a simulated vehicle": (
        "vehicles:\n  uav1: {autopilot: builtin, radio: none}\n",
        "2: vehicles.uav1.radio: ",
        "is for autopilot: hardware, but uav1 has autopilot: builtin. Remove the key.",
    ),
    "program of a real vehicle that always restarts": (  # review fault 9
        NATNET + f"  uav1: {{{REAL}, program: {{path: hover.py, restart: always}}}}\n",
        "3: vehicles.uav1.program.restart: ",
        "got always, but a program of a real vehicle must not take off again by itself. Use never or on_failure.",
    ),
    "radio that is not a radio": (
        NATNET + f"  uav1: {{{REAL}, radio: optional}}\n",
        "3: vehicles.uav1.radio: ",
        "got 'optional', expected required or none.",
    ),
    "values measured on a simulated vehicle": (
        "vehicles:\n  uav1: {autopilot: builtin, measured: {MPC_XY_P: {value: 1.0, date: 2026-11-20, how: tuned}}}\n",
        "2: vehicles.uav1.measured: ",
        "is for autopilot: hardware",
    ),
    "measured on no day": (
        NATNET + f"  uav1: {{{REAL}, measured: {{MPC_XY_P: {{value: 1.0, date: yesterday, how: tuned}}}}}}\n",
        "3: vehicles.uav1.measured.MPC_XY_P.date: ",
        "got 'yesterday', expected a date such as 2026-11-20.",
    ),
    "measured and set to another value": (
        NATNET
        + f"  uav1: {{{REAL}, params: {{MPC_XY_P: 0.9}}, measured: {{MPC_XY_P: {{value: 1.0, date: 2026-11-20, how: tuned}}}}}}\n",
        "3: vehicles.uav1.measured.MPC_XY_P: ",
        "got 1 from 2026-11-20, but `params` has 0.9. Remove one of them.",
    ),
    "signing of a simulated vehicle": (
        "vehicles:\n  uav1: {autopilot: builtin, signing: {key_file: uav1.key}}\n",
        "2: vehicles.uav1.signing: ",
        "is for autopilot: hardware",
    ),
    "signing with a key that is missing": (
        NATNET + f"  uav1: {{{REAL}, px4_version: '1.18', signing: {{key_file: uav1.key}}}}\n",
        "3: vehicles.uav1.signing.key_file: ",
        "cannot be read: No such file or directory. `arena signing new FILE` makes a key.",
    ),
    "hardware that nobody sees": (
        "vehicles:\n  uav1: {autopilot: hardware, profile: iris, radio: none, url: 'udpin:0.0.0.0:14540'}\n",
        "2: vehicles.uav1.autopilot: ",
        "the emulator cannot see",
    ),
    "hardware with a word for a url": (
        NATNET + "  uav1: {autopilot: hardware, profile: iris, radio: none, url: here}\n",
        "3: vehicles.uav1.url: ",
        "got 'here', expected udpin:HOST:PORT",
    ),
    "hardware by a host name": (
        NATNET + "  uav1: {autopilot: hardware, profile: iris, radio: none, url: 'udpout:drone:14540'}\n",
        "3: vehicles.uav1.url: ",
        "HOST must be a numeric IPv4 address, got 'drone'",
    ),
    "hardware that is spoken to everywhere": (
        NATNET + "  uav1: {autopilot: hardware, profile: iris, radio: none, url: 'udpout:0.0.0.0:14540'}\n",
        "3: vehicles.uav1.url: ",
        "got the broadcast, multicast or wildcard address 0.0.0.0",
    ),
    "two hardware vehicles on one port": (
        NATNET
        + "  uav1: {autopilot: hardware, profile: iris, radio: none, url: 'udpin:0.0.0.0:14540'}\n  uav2: {autopilot: hardware, profile: iris, radio: none, url: 'udpin:10.0.0.9:14540'}\n",
        "4: vehicles.uav2.url: ",
        "which is also the connection of uav1",
    ),
    "hardware faster than time": (
        "sim: {speed: 2}\n"
        + NATNET
        + "  uav1: {autopilot: hardware, profile: iris, radio: none, url: 'udpin:0.0.0.0:14540'}\n",
        "1: sim.speed: ",
        "real time only",
    ),
    "poses on a slow radio": (
        NATNET
        + "  uav1: {autopilot: hardware, profile: iris, radio: none, url: 'serial:/dev/ttyUSB0', baud: 57600}\n",
        "3: vehicles.uav1.baud: ",
        "Try 230400 or a lower pose_rate_hz",
    ),
    "hitl on a slow wire": (
        "vehicles:\n  uav1: {autopilot: hitl, serial: /dev/ttyACM0, baud: 115200}\n",
        "2: vehicles.uav1.baud: ",
        "Try 460800.",
    ),
    "satellites for the built-in autopilot": (
        "vehicles:\n  uav1: {autopilot: builtin, gps: true}\n",
        "2: vehicles.uav1.gps: ",
        "for autopilot: px4 or hitl",
    ),
    "sticks for a board in the loop": (
        "vehicles:\n  uav1: {autopilot: hitl, serial: /dev/a, sticks: true}\n",
        "2: vehicles.uav1.sticks: ",
        "for autopilot: px4 or builtin,",
    ),
    "hitl with a url": (
        "vehicles:\n  uav1: {autopilot: hitl, serial: /dev/a, url: 'udpin:0.0.0.0:1'}\n",
        "2: vehicles.uav1.url: ",
        "is for autopilot: hardware",
    ),
    "mocap source natnet without a server": (
        "mocap: {source: natnet}\nvehicles:\n" + V1,
        "1: mocap.source: ",
        "needs `server`",
    ),
    "mocap source natnet for simulated vehicles": (
        NATNET + V1,
        "1: mocap.source: ",
        "every vehicle is simulated",
    ),
    "mocap source vrpn": (
        "mocap: {source: vrpn}\nvehicles:\n" + V1,
        "1: mocap.source: ",
        "vrpn is not available yet",
    ),
    "mocap server beside the emulator": (
        "mocap: {server: 10.0.0.2}\nvehicles:\n" + V1,
        "1: mocap.server: ",
        "Set mocap.source: natnet",
    ),
    "failsafe": (
        "failsafe: {offboard_loss: land}\nvehicles:\n" + V1,
        "1: failsafe.offboard_loss: ",
        "keys such as action, after_s",
    ),
    "failsafe that comes before it warns": (
        "failsafe: {low_battery: {warn: 0.05, land: 0.1}}\nvehicles:\n" + V1,
        "1: failsafe.low_battery: ",
        "expected `land` (battery charge) below `warn`",
    ),
    "geofence with an action of its own": (
        "geofence: {action: land}\nvehicles:\n" + V1,
        "1: geofence.action: ",
        "unknown key. Did you mean failsafe.geofence.action?",
    ),
    "a failsafe outside of `failsafe`": (
        "offboard_loss: {after_s: 2}\nvehicles:\n" + V1,
        "1: offboard_loss: ",
        "unknown key. Did you mean failsafe.offboard_loss?",
    ),
    "a key that several sections have": (
        "after_s: 2\nvehicles:\n" + V1,
        "1: after_s: ",
        "unknown key. Known: name, ",
    ),
    "geofence the wrong way round": (
        "geofence: {east: [1, -1]}\nvehicles:\n" + V1,
        "1: geofence.east: ",
        "got [1, -1], expected the smaller number first. Try [-1, 1].",
    ),
    "geofence through a wall": (
        "geofence:\n  up: 2\n  north: [-4, 1]\nvehicles:\n" + V1,
        "3: geofence.north: ",
        "within the room's walls, -3.5 .. 3.5. Try [-3.5, 1].",
    ),
    "geofence outside the room": (
        "geofence: {east: [5, 6]}\nvehicles:\n" + V1,
        "1: geofence.east: ",
        "Try [-2, 2].",
    ),
    "geofence through the ceiling": (
        "geofence: {up: 3.5}\nvehicles:\n" + V1,
        "1: geofence.up: ",
        "at most the room's height, 3. Try 3.",
    ),
    "geofence that is all margin": (
        "geofence: {margin_m: 2.5}\nvehicles:\n" + V1,
        "1: geofence.margin_m: ",
        "nothing remains of east -2 .. 2. Try 0.5.",
    ),
    "geofence lower than its margin": (
        "geofence: {up: 0.5, margin_m: 0.5}\nvehicles:\n" + V1,
        "1: geofence.margin_m: ",
        "nothing remains of a fence 0.5 m high",
    ),
    "start outside the geofence": (
        "geofence: {north: [-1, 1]}\nvehicles:\n  uav1: {start: {position: [2, 0, 0]}}\n",
        "3: vehicles.uav1.start.position: ",
        "outside the geofence (arena.yaml:1): got N 2, expected -1 .. 1",
    ),
    "start above the geofence": (
        "geofence: {up: 1}\nvehicles:\n  uav1: {start: {position: [0, 0, -1.5]}}\n",
        "3: vehicles.uav1.start.position: ",
        "above the geofence (arena.yaml:1): got D -1.5",
    ),
    "attitude failure within what it may tilt": (
        "failsafe: {attitude: {action: terminate, above_deg: 40}}\nvehicles:\n" + V1,
        "1: failsafe.attitude.above_deg: ",
        "50",
    ),
    "hosts": ("hosts: {pi: {address: 10.0.0.2}}\nvehicles:\n" + V1, "1: hosts: ", "not available yet"),
    "parameter file that is not there": (
        "vehicles:\n  uav1: {params_file: a.params}\n",
        "2: vehicles.uav1.params_file: ",
        "got 'a.params', which cannot be read",
    ),
    "parameter file that is none": (
        "vehicles:\n  uav1: {params_file: notes.txt}\n",
        "2: vehicles.uav1.params_file: ",
        "notes.txt: ",
    ),
    "url of a simulated vehicle": (
        "vehicles:\n  uav1: {url: 'udpin:0.0.0.0:1'}\n",
        "2: vehicles.uav1.url: ",
        "is for autopilot: hardware",
    ),
    "tool without a command": (
        "tools:\n  rec:\n    env: {}\nvehicles:\n" + V1,
        "2: tools.rec.argv: ",
        "is missing",
    ),
    "tool as one string": (
        "tools:\n  rec: {argv: ls -l}\nvehicles:\n" + V1,
        "2: tools.rec.argv: ",
        "expected a list. Did you mean [ls, -l]?",
    ),
    "tool that needs nothing known": (
        "tools:\n  a: {argv: [x], needs: [rooter]}\nvehicles:\n" + V1,
        "2: tools.a.needs: ",
        "router",
    ),
    "tools that need each other": (
        "tools:\n  a: {argv: [x], needs: [tool.b]}\n  b: {argv: [x], needs: [tool.a]}\nvehicles:\n" + V1,
        "2: tools.a.needs: ",
        "List this tool below the tool that it needs",
    ),
    "no vehicles": ("name: x\n", "1: vehicles: ", "is missing. Give at least one vehicle"),
    "an empty list of vehicles": ("vehicles: {}\n", "1: vehicles: ", "at least 1"),
    "a vehicle without a body": ("vehicles:\n  uav1:\n", "2: vehicles.uav1: ", "got nothing"),
    "a tab": ("vehicles:\n\tuav1: {}\n", "2: ", "not tabs"),
    "an open bracket": ("vehicles:\n  uav1: {start: [0, 0\n", "3: ", "is not YAML"),
    "two documents": ("vehicles:\n" + V1 + "---\na: 1\n", "3: ", "another document"),
    "an alias to nothing": ("vehicles:\n  uav1: *base\n", "2: ", "undefined alias"),
    "an alias to itself": ("vehicles: &v\n  uav1: *v\n", "1: vehicles.uav1: ", "contains itself"),
    "a tag that runs code": (
        "name: !!python/object/apply:os.getcwd []\nvehicles:\n" + V1,
        "1: name: ",
        "Remove the tag",
    ),
    "a control character": ("name: a\x01\nvehicles:\n" + V1, "1: ", "which YAML does not allow"),
    "brackets without end": ("a: " + "[" * 5000, "1: ", "nested too deeply"),
    "a merge key": (
        "base: &b {id: 1}\nvehicles:\n  uav1: {<<: *b}\n",
        "3: vehicles.uav1.<<: ",
        "unknown key",
    ),
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "hover.py").touch()
    (tmp_path / "notes.txt").write_text("a note\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def problems(text: str, *overrides: str) -> list[str]:
    Path("arena.yaml").write_text(text)
    with pytest.raises(InputError) as raised:
        make_plan(load_arena("arena.yaml", overrides))
    assert raised.value.exit_code == 2
    return [str(problem) for problem in raised.value.problems]


@pytest.mark.parametrize("kind", BROKEN)
def test_mistake_gives_one_problem_of_one_line_with_its_place(kind: str, folder: Path) -> None:
    text, place, words = BROKEN[kind]
    lines = problems(text)
    told = [line for line in lines if line.startswith(f"arena.yaml:{place}") and words in line]
    assert len(told) == 1, lines
    assert "\n" not in told[0]
    assert len(lines) == 1 or kind == "a merge key", lines


def test_all_problems_are_reported_in_the_order_of_the_file(folder: Path) -> None:
    text = "nme: x\nsim: {gui: 3}\nvehicles:\n  uav1: {pose_rate_hz: 70}\n  uav2: {id: 1}\n  Uav3: {profile: x, start: {position: [9, 0, 0]}}\n"
    told = problems(text)
    assert [line.split(":")[1] for line in told] == sorted(line.split(":")[1] for line in told)
    for field in (
        "nme",
        "sim.gui",
        "vehicles.uav1.pose_rate_hz",
        "vehicles.Uav3.profile",
        "vehicles.Uav3.start.position",
    ):
        assert any(f" {field}: " in line for line in told), field


def test_wrong_value_is_reported_once(folder: Path) -> None:
    told = problems("vehicles:\n  uav1: {start: {position: [0, x, 0]}}\n  uav2: {id: one}\n")
    assert len(told) == 2, told


def test_problem_of_an_override_names_the_override(folder: Path) -> None:
    text = "vehicles:\n" + V1
    assert problems(text, "mocap.rate_hz=fast") == ["--set: mocap.rate_hz: got 'fast', expected a number."]
    assert "expected key=value" in problems(text, "mocap.rate_hz")[0]
    assert "is not a mapping" in problems(text, "vehicles.uav1.program.path=x")[0]


def test_unreadable_file_is_reported(folder: Path) -> None:
    for name, words in (
        ("none.yaml", "No such file"),
        (".", "No such file"),
        ("hover.py/x", "Not a directory"),
    ):
        with pytest.raises(InputError, match=words):
            load_arena(name)
    Path("latin.yaml").write_bytes(b"name: \xe9")
    with pytest.raises(InputError, match="UTF-8"):
        load_arena("latin.yaml")
    Path("empty.yaml").write_text("# nothing\n")
    with pytest.raises(InputError, match="is empty"):
        load_arena("empty.yaml")


def test_aliases_have_a_limit(folder: Path) -> None:
    text = "a0: &a0 [x]\n" + "".join(
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12)
    )
    assert "expands to more than" in problems(text)[0]
