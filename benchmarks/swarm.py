"""Plot the word that examples/11_swarm writes, and print the smallest distance of two vehicles.

    python benchmarks/swarm.py RUN_FOLDER --plot swarm.png

The picture shows the true positions at the end of the word, from the front (south) and from the side (east).
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np

AXES = ("north", "east", "down")


def tracks(run: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the times (T,) [s] and the true positions (V, T, 3) [m] [NED] of all vehicles."""
    each = []
    for file in sorted((run / "csv").glob("uav*.csv")):
        with file.open() as opened:
            rows = [r for r in csv.DictReader(opened) if r["truth.pos.north"]]
        times = np.array([float(r["time.seconds"]) for r in rows])
        each.append((times, np.array([[float(r[f"truth.pos.{a}"]) for a in AXES] for r in rows])))
    common = np.arange(max(t[0] for t, _ in each), min(t[-1] for t, _ in each), 0.05)
    return common, np.array([[np.interp(common, t, p[:, k]) for k in range(3)] for t, p in each]).swapaxes(
        1, 2
    )


def written(times: np.ndarray, at: np.ndarray) -> int:
    """Return the index of the time at which the word is complete: the last 1 s in which all vehicles are slow and high."""
    slow = np.linalg.norm(np.gradient(at, times, axis=1), axis=2).max(0) < 0.3
    high = at[:, :, 2].max(0) < -1.5
    return int(np.flatnonzero(slow & high)[-1])


def nearest(at: np.ndarray) -> float:
    """Return the smallest distance of two vehicles [m]."""
    pairs = np.triu_indices(len(at), 1)
    return min(
        np.linalg.norm(at[:, None, k] - at[None, :, k], axis=2)[pairs].min() for k in range(at.shape[1])
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("run", type=Path)
    parser.add_argument("--plot", type=Path)
    given = parser.parse_args()
    times, at = tracks(given.run)
    print(f"{len(at)} vehicles, {times[-1] - times[0]:.1f} s, smallest distance {nearest(at):.2f} m")
    if given.plot is None:
        return
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    p = at[:, written(times, at)]
    figure, (front, side) = plt.subplots(1, 2, figsize=(10, 4.4), width_ratios=[2.4, 1], sharey=True)
    front.scatter(p[:, 1], -p[:, 2], s=45, color="tab:blue")
    front.set(xlabel="east [m]", ylabel="height [m]", title="from the front", aspect="equal", ylim=(0, 12))
    side.scatter(p[:, 0], -p[:, 2], s=45, color="tab:orange")
    side.set(xlabel="north [m]", title="from the side", aspect="equal")
    for axes in (front, side):
        axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(given.plot, dpi=80)


if __name__ == "__main__":
    main()
