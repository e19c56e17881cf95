"""Draw the preview picture of links to this site: ``python docs/make_card.py``."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import pymc_hyperelastic as ph

GROUND, INK, COLOURS = "#14181e", "white", {"C1": "#f59e0b", "C2": "#38bdf8"}

SENTENCE = """Bayesian tubes and sheets on PyMC:
materials, groups and probabilities
of class, with their errors"""

data = ph.load_dataset("simulated_sheep_aorta")
figure = plt.figure(figsize=(12, 6.3), facecolor=GROUND)
figure.text(0.06, 0.62, "pymc_hyperelastic", color=INK, size=37, weight="bold")
figure.text(
    0.06,
    0.36,
    SENTENCE,
    color=INK,
    size=21,
    linespacing=1.5,
)
figure.text(0.06, 0.08, "Curves: simulated data", color="0.7", size=14)
axes = figure.add_axes((0.62, 0.12, 0.34, 0.78), facecolor=GROUND)
for test in np.unique(data["test"]):
    points = data.isel(obs=data["test"].values == test)
    colour = COLOURS[data["group"].values[test]]
    axes.plot(points["radius"], points["pressure"] / ph.mmHg, "o-", color=colour, alpha=0.7)
axes.set_xlabel("internal radius (mm)", color=INK, size=16)
axes.set_ylabel("pressure (mmHg)", color=INK, size=16)
axes.tick_params(colors=INK, labelsize=13)
for side, spine in axes.spines.items():
    spine.set_visible(side in ("left", "bottom"))
    spine.set_color(INK)
figure.savefig(Path(__file__).parent / "_static" / "card.png", dpi=100, facecolor=GROUND)
