"""Make ``_static/cards/*.png``, the pictures of the front page, from SIMULATED aortas.

Run it as ``python docs/make_card_pictures.py``; it takes about two minutes.
"""

import warnings
from io import BytesIO
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import pymc_hyperelastic as ph

FOLDER = Path(__file__).parent / "_static" / "cards"
SIZE, DPI = (4.0, 2.5), 200  # of every picture, in inches and dots per inch
SAMPLING = {"draws": 1000, "chains": 2, "random_seed": 1, "progressbar": False}


def save(name: str) -> None:
    """Write the current figure with 64 colours, and close it."""
    file = BytesIO()
    plt.gcf().savefig(file, dpi=DPI)
    plt.close()
    image = Image.open(file).convert("RGB").quantize(64)
    image.save(FOLDER / f"{name}.png", optimize=True)


def axes(xlabel: str, ylabel: str = ""):
    """Return the axes of a new picture."""
    plt.style.use({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    ax = plt.figure(figsize=SIZE, layout="constrained").add_subplot()
    ax.set(xlabel=xlabel, ylabel=ylabel)
    return ax


FOLDER.mkdir(exist_ok=True)
data = ph.load_dataset("simulated_sheep_aorta")
groups = {name: ph.select(data, group=name) for name in ("C1", "C2")}
classes = ph.fit_classes(
    ph.Ogden(), groups, ph.Gaussian(3 * ph.mmHg), variability="specimen", **SAMPLING
)

# Fit: the pressure of two specimens.
ax = axes("internal radius (mm)", "pressure (mmHg)")
for i, (specimen, group) in enumerate({"S1": "C1", "S4": "C2"}.items()):
    tests = ph.select(data, specimen=specimen)
    radius = np.linspace(7.08, float(tests["radius"].max()), 40)
    curve = ph.predict_pressure(classes[group], radius, specimen=specimen)["pressure"] / ph.mmHg
    low, high = curve.quantile([0.025, 0.975], ["chain", "draw"]).values
    ax.fill_between(radius, low, high, color=f"C{i}", alpha=0.4)
    ax.plot(tests["radius"], tests["pressure"] / ph.mmHg, f"C{i}.", ms=4, label=specimen)
ax.legend(frameon=False)
save("fit")

# Classify a specimen that was left out.
known = {
    "C1": ph.select(data, specimen=["S1", "S2"]),
    "C2": ph.select(data, specimen=["S4", "S5"]),
}
# The same settings, and so the same numbers, as in the ten lines on the front page.
likelihood = ph.Gaussian(pressure_sd=3 * ph.mmHg)
seed = {"random_seed": 1, "progressbar": False}
learned = ph.fit_classes(ph.Ogden(), known, likelihood, variability="specimen", **seed)
answer = ph.classify(ph.select(data, specimen="S3"), learned, by="specimen", **seed)
ax = axes("", "probability")
chance = answer["class_probability"].squeeze().to_series()
bars = ax.bar(chance.index, chance, color=["C0", "C1"], alpha=0.7, width=0.5)
ax.bar_label(bars, fmt="%.2f")
ax.axhline(0.8, color="k", ls=":", lw=1)
ax.text(1.45, 0.82, "asked for a decision", ha="right", fontsize=8)
ax.set(ylim=(0, 1), xlim=(-0.5, 1.5), title="new specimen S3: undecided")
save("classify")

# Compare: differences between two groups.
with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # a few draws have no compliance at that pressure
    compared = ph.compare_classes(
        classes,
        ["log compliance", "log distensibility", "log pulse_wave_velocity"],
        at=ph.Conditions(80, pressure_unit="mmHg"),
        effect_prior=None,
        random_seed=1,
    )
typical = compared.sel(statistic="typical").squeeze("comparison")
ax = axes("difference of logarithms, C2 less C1")
low, high = typical["difference_interval"].transpose("bound", ...).values
middle = typical["difference"].values
rows = np.arange(middle.size)
ax.errorbar(middle, rows, xerr=[middle - low, high - middle], fmt="o", color="C0")
ax.axvline(0, color="0.6", lw=1)
ax.set_yticks(rows, ["compliance", "distensibility", "pulse wave\nvelocity"])
ax.set_ylim(-0.5, 2.5)
ax.locator_params(axis="x", nbins=5)
ax.invert_yaxis()
save("compare")

# Laws: evidence.
laws = (ph.Demiray(), ph.Ogden(), ph.CriscioneType(), ph.PowerLawNeoHookean())
evidence = {}
for law in laws:
    model = ph.inflation_model(law, ph.select(data, specimen="S1"), likelihood)
    evidence[law.name] = ph.log_evidence(ph.sample_smc(model, **SAMPLING))
best = max(e.value for e in evidence.values())
ax = axes("log evidence less the largest (nats)")
for row, e in enumerate(evidence.values()):
    ax.errorbar(e.value - best, row, xerr=2 * e.standard_error, fmt="o", color="k")
ax.set_yticks(range(4), ["Demiray", "Ogden", "Criscione-\ntype", "power-law\nneo-Hookean"])
ax.set_ylim(-0.5, 3.5)
ax.invert_yaxis()
save("laws")

# Properties: compliance over pressure.
ax = axes("pressure (mmHg)", "compliance (mm²/kPa)")
at = np.arange(40, 150, 5.0)
for i, (specimen, group) in enumerate({"S1": "C1", "S4": "C2"}.items()):
    in_mmhg = ph.Conditions(at, pressure_unit="mmHg")
    found = ph.tube_properties(classes[group], in_mmhg, specimen=specimen)
    low, middle, high = found["compliance"].quantile([0.025, 0.5, 0.975], ["chain", "draw"]).values
    ax.fill_between(at, low, high, color=f"C{i}", alpha=0.3)
    ax.plot(at, middle, color=f"C{i}", label=specimen)
ax.legend(frameon=False)
save("properties")

# Design: how many animals.
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    in_mmhg = ph.Conditions(80, pressure_unit="mmHg")
    plan = ph.plan_study(classes, "log compliance", at=in_mmhg, studies=100, random_seed=1)
ax = axes("specimens of each group", "share of studies that decide")
decided = plan["decided"].squeeze()
ax.errorbar(plan["specimens"], decided, 2 * plan["decided_se"].squeeze(), marker="o", color="C0")
ax.set_ylim(0, 1)
save("design")
