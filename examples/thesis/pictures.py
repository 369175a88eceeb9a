"""Draw the paths of a run from above and the heights over time, actual beside desired.

python examples/thesis/pictures.py RUN PICTURE.png [VEHICLE ...]
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt

from arena.flight_log.open import read_flights


def main(run: str, picture: str, *names: str) -> None:
    figure, (above, height) = plt.subplots(
        1, 2, figsize=(10, 4.5), width_ratios=(1, 1.3), layout="constrained"
    )
    flights = [f for f in read_flights(Path(run)) if not names or f.name in names]
    for colour, flight in zip(plt.cm.tab10.colors, flights, strict=False):
        rows = flight.offboard
        t = (flight.t - flight.t[rows.argmax()])[rows]
        actual, desired = flight.group("ekf.pos")[rows], flight.group("pos_ref")[rows]
        above.plot(desired[:, 1], desired[:, 0], "--", color=colour, linewidth=0.8)
        above.plot(actual[:, 1], actual[:, 0], color=colour, linewidth=1.2)
        height.plot(t, -desired[:, 2], "--", color=colour, linewidth=0.8)
        height.plot(t, -actual[:, 2], color=colour, linewidth=1.2, label=flight.name)
    above.set(xlabel="east [m]", ylabel="north [m]", aspect="equal", title="from above")
    height.set(xlabel="time since OFFBOARD [s]", ylabel="height [m]", title="dashed: desired")
    height.legend(loc="upper right")
    figure.savefig(picture, dpi=90)


if __name__ == "__main__":
    main(*sys.argv[1:])
