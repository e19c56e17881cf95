"""
Three axial stretches: predict one from the other two
=====================================================

Inflation at one axial stretch gives information only about the hoop direction of a wall. The
vaginal walls of eight mice, before and after elastase, were **measured** by inflation at three
axial stretches each. For each of the 16 specimens, a law is fitted to the curves at the lowest and
the highest stretch, and predicts the outer diameter at the middle stretch.

**Limits.** The predicted stretch lies between two measured stretches of the same specimen. The
errors therefore show how well a law couples the two directions, not how well it predicts another
animal. The two states of an animal are not independent. If a law does not fit an axial stretch, the
errors of all points of its curve are correlated, but the likelihood assumes independent errors:
over all specimens the intervals of the two anisotropic laws are too narrow. The intervals of
Ogden's law, which has the worst fit, are wide. So are those of the other laws for tubes that they
do not fit (elastase4, elastase7). No law fits a tube whose middle curve lies outside the other two,
or a tube that widens when it is stretched; some specimens do so. The reference is a prediction
without a law: the diameter at the same pressure, interpolated between the other two curves.

The measurements are those of A. R. Akintunde et al., Journal of Biomechanical Engineering 141
(2019) 021011. They are not part of this package. The module :download:`murine_tables.py` reads
them. Save it beside this script; it states where it looks for the tables.
"""

# sphinx_gallery_thumbnail_path = "stored/three_axial_stretches/middle_stretch.png"

import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import murine_tables
import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr

import pymc_hyperelastic as ph

DRAWS, CHAINS = 300, 2  # draws in a chain, and number of chains
OUT = Path("results/three_axial_stretches")  # folder of the results
OUT.mkdir(parents=True, exist_ok=True)
rng = np.random.default_rng(3)

# %%
# The specimens
# -------------
# The stress-free tube is the opened ring. Points below 3.5 mmHg are left out, because the wall is
# still folded there.
data, geometry = murine_tables.read()
specimens = list(geometry["specimen"])

# %%
# Laws and assumptions
# --------------------
# Ogden's law is isotropic; the other two laws are anisotropic. The wall is soft, and then stiffens
# within a few hundredths of strain, much sooner than an artery. Therefore the priors of the
# exponents are wider than the defaults, and those of the moduli narrower, the same for all
# specimens. The size of the pressure errors is inferred. Slopes are not used. The measured axial
# forces are not used either: with forces, the diameters predicted by Fung's law are worse.
LAWS = {
    ph.Ogden(): {"mu": pm.Uniform.dist(0, 50), "alpha": pm.Uniform.dist(0, 80)},
    ph.HolzapfelGasserOgden(): {
        "c": pm.Uniform.dist(0, 20),
        "k1": pm.Uniform.dist(0, 50),
        "k2": pm.Uniform.dist(0, 200),
    },
    ph.FungOrthotropic(): {
        "c": pm.Uniform.dist(0, 20),
        "a1": pm.Uniform.dist(0, 300),
        "a2": pm.Uniform.dist(0, 300),
        "a4": pm.Uniform.dist(0, 100),
    },
}


def fit(energy: ph.StrainEnergy, curves: xr.Dataset) -> xr.DataTree:
    """Sample the posterior of the material and of the size of the errors."""
    model = ph.inflation_model(
        energy,
        curves,
        ph.Gaussian(pressure_sd=pm.HalfNormal.dist(4 * ph.mmHg)),
        priors=LAWS[energy],
    )
    return ph.sample_smc(model, DRAWS, CHAINS, 1)


def predicted_diameter(tree: xr.DataTree, pressure: np.ndarray, stretch: float) -> list[np.ndarray]:
    """Return the outer diameter (µm) at pressures (kPa): median, and 95 % interval of measurements.

    A pressure error changes the inner radius by error / stiffness. The area of the wall is
    constant, so the outer radius changes by inner / outer of that. Draws that do not reach a
    pressure are left out there.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "of .* draws .* do not reach")
        at = ph.Conditions(pressure, tube=ph.Tube(axial_stretch=stretch))
        inflated = ph.tube_properties(tree, at)
    sd = tree["posterior"]["pressure_sd"]
    error = sd * sd.copy(data=rng.normal(size=sd.shape))
    outer = inflated["outer_radius"]
    measured = outer + inflated["radius"] / (outer * inflated["stiffness"]) * error
    low, high = measured.quantile([0.025, 0.975], dim=("chain", "draw")).values
    return [2e3 * radius for radius in (outer.median(dim=("chain", "draw")).values, low, high)]


# %%
# Fit the outer two stretches, predict the middle one
# ---------------------------------------------------
evidence, bands, errors = {}, {}, {}
for specimen in specimens:
    print(f"{specimen}: {', '.join(energy.name for energy in LAWS)}")
    outer = ph.select(data, specimen=specimen, experiment=["test1", "test3"])
    left_out = ph.select(data, specimen=specimen, experiment="test2")
    measured = 1e3 * left_out["outer_diameter"].values
    for energy in LAWS:
        tree = fit(energy, outer)
        middle, low, high = predicted_diameter(
            tree, left_out["pressure"].values, left_out["axial_stretch"].item()
        )
        bands[specimen, energy.name] = middle, low, high
        errors[specimen, energy.name] = middle - measured, (low <= measured) & (measured <= high)
        evidence[specimen, energy.name] = ph.log_evidence(tree)
    # Without a law: interpolate the diameters at the same pressure linearly in the axial stretch.
    curves = [outer.isel(obs=outer["test"] == test) for test in (0, 1)]
    sides = [
        np.interp(left_out["pressure"], curve["pressure"], 1e3 * curve["outer_diameter"])
        for curve in curves
    ]
    first, last = outer["axial_stretch"].values
    share = (left_out["axial_stretch"].item() - first) / (last - first)
    between = (1 - share) * sides[0] + share * sides[1]
    errors[specimen, "(between)"] = between - measured, np.zeros(measured.size, bool)

# %%
# The numbers
# -----------
laws = [energy.name for energy in LAWS]
best = {s: max(laws, key=lambda law: evidence[s, law]) for s in specimens}
rows, totals = [], []
for specimen in specimens:
    row = {"specimen": specimen}
    for law in ("(between)", *laws):
        error, inside = errors[specimen, law]
        row[law] = f"{np.abs(error).mean():.0f} / {np.abs(error).max():.0f}"
        row[law] += f" / {inside.sum()} of {inside.size}" if law in laws else ""
    rows.append(row)
print(
    "\nOuter diameter at the middle axial stretch, µm: mean / largest error / in the 95 % interval"
)
print(pd.DataFrame(rows).to_string(index=False))
pd.DataFrame(rows).to_csv(OUT / "errors.csv", index=False)

for law in ("(between)", *laws):
    error = np.abs(np.concatenate([errors[specimen, law][0] for specimen in specimens]))
    inside = np.concatenate([errors[specimen, law][1] for specimen in specimens])
    row = {"law": law, "mean error, µm": f"{error.mean():.0f}", "largest": f"{error.max():.0f}"}
    if law in laws:
        row["in the 95 % interval"] = f"{inside.mean():.0%}"
        values = np.array([evidence[specimen, law] for specimen in specimens])
        row["log evidence, sum"] = (
            f"{values[:, 0].sum():.1f} ± {np.sqrt((values[:, 1] ** 2).sum()):.1f}"
        )
        row["best of"] = str(list(best.values()).count(law))
    totals.append(row)
print(f"\nAll {len(specimens)} specimens")
print(pd.DataFrame(totals).fillna("").to_string(index=False))

rows = [{"specimen": s} | {law: str(evidence[s, law]) for law in laws} for s in specimens]
print("\nLog evidence of the two outer axial stretches")
print(pd.DataFrame(rows).to_string(index=False))

# %%
# The figure
# ----------
# Grey points are the two fitted curves, ▼ at the lowest and ▲ at the highest axial stretch. Lines
# are the predicted medians. The band of the law with the largest evidence should contain 95 % of
# the measurements.
figure, axes = plt.subplots(4, 4, figsize=(12, 11), sharex=True, layout="constrained")
for ax, specimen in zip(axes.flat, specimens, strict=True):
    curves = ph.select(data, specimen=specimen)
    for test, marker in enumerate(("v", "o", "^")):
        curve = curves.isel(obs=curves["test"] == test)
        x, y = curve["pressure"] / ph.mmHg, 1e3 * curve["outer_diameter"]
        if test != 1:
            ax.plot(x, y, marker, color="0.7", ms=4)
            continue
        for number, law in enumerate(laws):
            median, low, high = bands[specimen, law]
            ax.plot(x, median, color=f"C{number}", label=law)
            if law == best[specimen]:
                ax.fill_between(x, low, high, color=f"C{number}", alpha=0.2, lw=0)
        ax.plot(x, y, marker, color="k", ms=4, label="measured, left out")
    diameters = 1e3 * curves["outer_diameter"]
    ax.set_ylim(diameters.min() - 150, diameters.max() + 150)
    ax.set_title(specimen, fontsize="medium")
handles, labels = axes.flat[0].get_legend_handles_labels()
figure.legend(handles, labels, ncols=4, loc="outside upper center")
figure.supxlabel("pressure (mmHg)")
figure.supylabel("outer diameter (µm)")
figure.savefig(OUT / "middle_stretch.png", dpi=150)
print(f"\nThe figure is in {OUT}/")
