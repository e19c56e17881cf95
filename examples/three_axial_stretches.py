"""
Three axial stretches: predict one from the other two
=====================================================

A wall that is inflated at one axial stretch tells its hoop direction only. These **measured**
tubes, the vaginal walls of eight mice before and after elastase, were inflated at three axial
stretches each. For each of the 16 the lowest and the highest train a law, and the outer diameter
at the one between is predicted.

**What this can and cannot show.** The stretch that is predicted lies between two that were
measured, on the same specimen: an error says how well a law couples the two directions, not how
well it speaks of another animal. The two states of an animal are not independent of each other.
All points of a curve err alike where a law misses its axial stretch, which the likelihood takes for
chance: over all specimens the intervals of the two laws with directions are too narrow; those of
Ogden's solid, which fits worst on the whole, are wide, and so are theirs on tubes that they cannot
follow (elastase4, elastase7). And no law follows a tube whose middle curve lies outside the
other two, or which widens as it is stretched; some of these do.
The comparison needs no material at all: at the same pressure, the diameter between those of the
other two curves.

The measurements are those of A. R. Akintunde et al., Journal of Biomechanical Engineering 141
(2019) 021011. They are not part of this package. They are read by :download:`murine_tables.py`,
which has to lie beside this script and says where it looks for the tables.
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

DRAWS, CHAINS = 300, 2  # particles of a chain, and independent runs
OUT = Path("results/three_axial_stretches")  # where results go
OUT.mkdir(parents=True, exist_ok=True)
rng = np.random.default_rng(3)

# %%
# The specimens
# -------------
# The tube that is free of stress is the cut ring, sprung open. Points below 3.5 mmHg are left out:
# there the wall, which lies folded at rest, is unfolding.
data, geometry = murine_tables.read()
specimens = list(geometry["specimen"])

# %%
# Laws, and what is assumed
# -------------------------
# Ogden's solid is isotropic; the other two tell the directions apart. The wall is soft, and then
# stiffens within a few hundredths of strain, far sooner than an artery: the exponents have wider
# priors than by default, and the moduli narrower ones, the same for all specimens. The size of the
# errors of pressure is inferred, and slopes play no part. Neither does the axial force, which was
# measured as well: with it Fung's law predicts the diameters worse, not better.
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
    """Posterior of the material and of the errors' size."""
    model = ph.inflation_model(
        energy,
        curves,
        ph.Gaussian(pressure_sd=pm.HalfNormal.dist(4 * ph.mmHg)),
        priors=LAWS[energy],
    )
    return ph.sample_smc(model, DRAWS, CHAINS, 1)


def predicted_diameter(tree: xr.DataTree, pressure: np.ndarray, stretch: float) -> list[np.ndarray]:
    """Outer diameter (µm) at pressures in kPa: median, and ends of 95 % of measurements.

    An error of pressure moves the inner radius by 1/stiffness, and the outer one, as the wall keeps
    its area, by inner/outer of that. Draws whose curve ends below a pressure are left out there.
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
# Train on the outer two, predict the middle one
# ----------------------------------------------
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
    # No law: between the diameters at the same pressure, in proportion to the axial stretch.
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
# Grey are the two curves that were trained on, ▼ at the lowest and ▲ at the highest axial stretch.
# Predicted is the median; the band, in which 95 % of measurements are expected, is that of the law
# with the largest evidence.
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
