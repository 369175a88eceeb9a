"""A choreographer: one program that flies 48 vehicles.

They take off, write F, L and Y letter by letter, and land. With the argument `F`, for example, it flies only the vehicles of
that letter.

The letters are seen from the south, from the front. A vehicle right below another one would be in its downwash, so the letters
lean back: a point that is 1 m higher is 0.8 m farther north. Seen from the front this is not visible.

No two vehicles come near each other on their way. They start at the same time, and fly straight at proportional speeds. Two
vehicles swap their goals wherever this shortens the sum of the squares of both ways. Then the angle between (start - other start)
and (goal - other goal) is at most 90 degrees for each pair, and the distance d of the pair is always at least
1 / sqrt(1 / d_start^2 + 1 / d_goal^2) (Turpin, Michael and Kumar, "CAPT: Concurrent assignment and planning of trajectories for
multiple robots", International Journal of Robotics Research, 2014).
"""

import numpy as np

from arena import UAV

FREQ_HZ = 20
WIDTH_M, HEIGHT_M, BOTTOM_M = 6.0, 8.0, 2.6
LEAN = 0.8  # metres north per metre up
WAIT_M = 1.2  # height above the floor
NEAR_M = 0.75  # smallest planned distance of two vehicles

# strokes of a letter: from and to, as shares of its width and height, and the number of points
LETTERS = {
    "F": [((0, 0), (0, 1), 8), ((0, 1), (1, 1), 7), ((0, 0.5), (0.7, 0.5), 5)],
    "L": [((0, 1), (0, 0), 9), ((0, 0), (1, 0), 7)],
    "Y": [((0, 1), (0.5, 0.5), 6), ((1, 1), (0.5, 0.5), 6), ((0.5, 0.5), (0.5, 0), 5)],
}
TEAMS = {"F": (18, -11.6), "L": (15, -3.0), "Y": (15, 5.6)}  # number of vehicles; left edge, east [m]


def letter(name, east):
    """Return the points of a letter [m] [NED] (n, 3). east: its left edge [m]. A point that two strokes share is taken once."""
    points = []
    for start, end, count in LETTERS[name]:
        for right, up in np.linspace(start, end, count) * [WIDTH_M, HEIGHT_M]:
            point = np.array([LEAN * up, east + right, -(BOTTOM_M + up)])
            if all(np.linalg.norm(point - other) >= NEAR_M for other in points):
                points.append(point)
    return np.array(points)


def assign(start, goal):
    """Return the goals in the order of the vehicles: goals are swapped until no two ways cross."""
    goal, swapped = goal.copy(), True
    while swapped:
        swapped = False
        for i in range(len(goal)):
            for j in range(i):
                if (start[i] - start[j]) @ (goal[i] - goal[j]) < 0:
                    goal[[i, j]], swapped = goal[[j, i]], True
    return goal


def nearest(start, goal):
    """Return the smallest distance of two vehicles on their way [m]."""
    at = start + np.linspace(0.0, 1.0, 101)[:, None, None] * (goal - start)
    apart = np.linalg.norm(at[:, :, None] - at[:, None], axis=3)
    return apart[:, *np.triu_indices(len(start), 1)].min()


def move(fleet, start, goal, seconds):
    """Fly all vehicles from `start` to `goal`, straight, with a smooth beginning and end (fifth-order polynomial)."""
    assert nearest(start, goal) >= NEAR_M
    way, began = goal - start, fleet.clock.now()
    while (s := (fleet.clock.now() - began) / seconds) < 1.0:
        place = s**3 * (10 - 15 * s + 6 * s**2)
        speed = 30 * s**2 * (1 - s) ** 2 / seconds
        fleet.set_pos_vel_yaw(start + place * way, speed * way, 0.0, FREQ_HZ)


def hold(fleet, goal, seconds):
    end = fleet.clock.now() + seconds
    while fleet.clock.now() < end:
        fleet.set_pos_yaw(goal, 0.0, FREQ_HZ)


with UAV.all_from_args() as fleet:
    word = fleet[0].args[0] if fleet[0].args else "FLY"
    fleet.start_offboard_mission()
    ground = fleet.pos
    waiting = ground * [1, 1, 0] - [0, 0, WAIT_M]
    move(fleet, ground, waiting, 5.0)
    now, first = waiting, 0
    for name in word:
        count, east = TEAMS[name]
        rows = slice(first, first + count)
        goal = now.copy()
        goal[rows] = assign(now[rows], letter(name, east))
        move(fleet, now, goal, 10.0)
        print(f"{name} is written", flush=True)
        now, first = goal, first + count
    hold(fleet, now, 3.0)
    print(f"worst_place_error_m: {np.linalg.norm(fleet.pos - now, axis=1).max():.3f}", flush=True)
    move(fleet, now, waiting, 11.0)
    fleet.auto_land()
