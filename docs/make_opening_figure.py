"""Make ``_static/opening_angle.png``: a closed ring, the sector to which it opens, and both angles.

Run it as ``python docs/make_opening_figure.py``.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Arc, Wedge

from pymc_hyperelastic.mechanics.tube import opened_sector

PATH = Path(__file__).parent / "_static" / "opening_angle.png"
RING, MISSING = (1.0, 1.45), 140.0  # radii, and the whole angle in degrees
WALL, WHOLE, FUNG = "0.85", "C0", "C3"


def line(ax, *points, **style):
    """Draw a line through points."""
    ax.plot(*np.transpose(points), **{"linewidth": 1, "color": "0.2"} | style)


def radius(ax, end, name, angle):
    """Draw an arrow from the centre to a circle, with the name of its radius."""
    tip = end * np.array([np.cos(angle), np.sin(angle)])
    ax.annotate("", tip, (0, 0), arrowprops={"arrowstyle": "->", "color": "0.2"})
    across = 0.13 * np.array([-np.sin(angle), np.cos(angle)])
    ax.text(*(0.35 * tip + across), name, ha="center", va="center")


figure, (closed, opened) = plt.subplots(1, 2, figsize=(9.5, 5.2), layout="constrained")
a, b = RING
closed.add_patch(Wedge((0, 0), b, 0, 360, width=b - a, facecolor=WALL, edgecolor="0.2"))
closed.plot(*(0.5 * (a + b) * f(np.linspace(0, 2 * np.pi, 200)) for f in (np.cos, np.sin)), "k:")
radius(closed, a, "$a$", np.radians(200))
radius(closed, b, "$b$", np.radians(-40))
line(closed, (0, a), (0, b), color="k", linewidth=2.5)
closed.annotate("cut", (0, b), (0.25, b + 0.25), arrowprops={"arrowstyle": "-"})
closed.set_title('closed unloaded ring: radii_of="ring"')

A, B = opened_sector(*RING, opening_angle=np.radians(MISSING))
gap = 90 + np.array([-1, 1]) * MISSING / 2  # where its ends are, in degrees
ends = [np.array([np.cos(t), np.sin(t)]) for t in np.radians(gap)]
opened.add_patch(
    Wedge((0, 0), B, gap[1], gap[0] + 360, width=B - A, facecolor=WALL, edgecolor="0.2")
)
middle = np.radians(np.linspace(gap[1], gap[0] + 360, 200))
opened.plot(*(0.5 * (A + B) * f(middle) for f in (np.cos, np.sin)), "k:")
radius(opened, A, "$A$", np.radians(200))
radius(opened, B, "$B$", np.radians(-40))
bottom = np.array([0.0, -A])
for end in ends:
    line(opened, (0, 0), A * end, color=WHOLE, linestyle="--")
    line(opened, bottom, A * end, color=FUNG, linestyle="--")
opened.add_patch(Arc((0, 0), 0.9, 0.9, theta1=gap[0], theta2=gap[1], color=WHOLE, linewidth=2))
fung = 90 + np.array([-1, 1]) * MISSING / 4
opened.add_patch(Arc(bottom, 1.5, 1.5, theta1=fung[0], theta2=fung[1], color=FUNG, linewidth=2))
opened.text(0, 0.62, r'$\Phi$  ("whole")', color=WHOLE, ha="center")
opened.text(0.08, -A + 0.88, r'$\Phi/2$  ("fung")', color=FUNG, ha="center")
opened.set_title('opened sector, the reference: radii_of="sector"')
for ax in (closed, opened):
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.set(xlim=(-B - 0.1, B + 0.1), ylim=(-B - 0.1, b + 0.5))
figure.savefig(PATH, dpi=110)
