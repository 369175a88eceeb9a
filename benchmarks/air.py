"""Plot of the downwash below a hovering iris and of gusts, for docs/explanation/physics.md.

python benchmarks/air.py --plot air.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot as plt

from arena.constants import GRAVITY_M_S2
from arena.schema import load_profile
from arena.sim.downwash import Downwash
from arena.sim.gusts import Gusts

WIND_20FT = 5.0
STEP_S = 0.02


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--plot", type=Path, required=True, metavar="FILE")
    path = options.parse_args().plot
    profile = load_profile("iris").slice()
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), constrained_layout=True)

    aside, below = np.linspace(-1.5, 1.5, 121), np.linspace(0.0, 4.0, 121)
    model = Downwash([profile] * (len(aside) + 1), strength=1.0)
    r_nb = np.tile(np.eye(3), (len(aside) + 1, 1, 1))
    thrust = np.zeros(len(aside) + 1)
    thrust[0] = profile["mass_kg"] * GRAVITY_M_S2
    rows = []
    for (
        z
    ) in below:  # the first vehicle hovers at the origin; the others, without thrust, are places in its wind
        places = np.stack([np.zeros_like(aside), aside, np.full_like(aside, z)], axis=1)
        rows.append(model.wind(np.vstack([np.zeros(3), places]), r_nb, lambda: thrust)[1:, 2])
    wind_n = np.array(rows)
    filled = left.contourf(aside, -below, wind_n, levels=np.arange(0.0, 6.1, 0.5), cmap="Blues")
    figure.colorbar(filled, ax=left, label="wind at a vehicle below [m/s]")
    left.set(
        xlabel="to the side [m]",
        ylabel="height relative to the iris [m]",
        title="downwash of a hovering iris",
    )

    gusts = Gusts([1], seed=1, wind_20ft=WIND_20FT, step_s=STEP_S)
    still = np.zeros((1, 3))
    seen = np.array([gusts.step(np.array([2.0]), still, still)[0] for _ in range(round(40.0 / STEP_S))])
    for name, values in zip(("north", "east", "down"), seen.T, strict=True):
        right.plot(np.arange(len(seen)) * STEP_S, values, linewidth=0.9, label=name)
    right.set(xlabel="time [s]", ylabel="gust [m/s]", title=f"gusts_m_s: {WIND_20FT:g}, height 2 m")
    right.legend(loc="upper right")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
