"""Draws docs/lookahead.svg: why straights and steady arcs do not tell the distance, and changing bends do.

Run `python docs/lookahead_picture.py` after changing pure pursuit.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

from wheelprint.dataset.pursuit import steering_towards

WHEELBASE, TRUE, NOISE, STEP = 2.82, 14.0, 0.05, 0.25
PLACES = (
    ("on a straight", 15.0, "#7f7f7f", (0, 10)),
    ("before a bend", 60.0, "#1f77b4", (-40, -16)),
    ("in a steady arc", 125.0, "#d62728", (-80, 4)),
)


def main() -> None:
    """Draw the road with its three cars, and what each distance would make them steer."""
    mpl.use("svg")
    mpl.rcParams["svg.hashsalt"] = "wheelprint"
    from matplotlib import pyplot as plt

    s = np.arange(0.0, 240.0, STEP)
    heading = np.cumsum(STEP * np.interp(s, [65, 85, 170, 190], [0, 1 / 60, 1 / 60, 0]))
    x, y = np.cumsum(STEP * np.cos(heading)), np.cumsum(STEP * np.sin(heading))
    h = np.linspace(3, 40, 200)
    figure, (road, curves) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    road.plot(x, y, color="#bbbbbb", linewidth=5, solid_capstyle="round")
    for name, at, colour, beside in PLACES:
        i = int(at / STEP)
        goal = int(np.argmax(np.hypot(x[i:] - x[i], y[i:] - y[i]) >= TRUE)) + i
        road.plot([x[i], x[goal]], [y[i], y[goal]], color=colour)
        road.plot(x[i], y[i], "o", x[goal], y[goal], "x", color=colour)
        road.annotate(name, (x[i], y[i]), xytext=beside, textcoords="offset points", color=colour, fontsize=9)
        ends = np.array([i]), np.array([len(x)])
        here = x[i : i + 1], y[i : i + 1], (heading[i : i + 1] + heading[i + 1 : i + 2]) / 2
        steering = steering_towards(*here, h[np.newaxis], x, y, *ends, WHEELBASE)[0]
        own = float(np.interp(TRUE, h, steering))
        curves.plot(h, steering, color=colour, label=name)
        curves.axhspan(own - NOISE, own + NOISE, color=colour, alpha=0.15, linewidth=0)
        explains = h[np.abs(steering - own) <= NOISE]
        curves.plot([explains[0], explains[-1]], [own, own], color=colour, linewidth=4, alpha=0.6)
    curves.axvline(TRUE, color="black", linewidth=0.8, linestyle=":")
    curves.set(xlabel="distance h, m", ylabel="steering δ₀(h) of pure pursuit, deg")
    curves.legend(fontsize=8)
    road.set(xlabel="x, m", ylabel="y, m", aspect="equal")
    figure.savefig(Path(__file__).with_name("lookahead.svg"), metadata={"Date": None})


if __name__ == "__main__":
    main()
