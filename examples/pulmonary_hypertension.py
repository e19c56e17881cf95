"""
A real artery: control against pulmonary hypertension
=====================================================

The data are measured inflation curves of mouse left pulmonary arteries: the mean curve of controls,
and the mean curve of animals with hypoxic pulmonary hypertension, with 11 points each. Every other
point of a curve is training data of its class. The other points are classified.

**Limits.** Each group is one mean curve. The posteriors show how the mean hypertensive artery
differs from the mean control. The points that are classified belong to the same two curves.
Classifying them checks the method, but gives no information about the differences between animals,
or about the classification of a new animal. The laws fit the control's curve badly, and the errors
of neighbouring points are correlated: the true uncertainty is larger than these posteriors show.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

import pymc_hyperelastic as ph

# The laws miss the control's curve by 5 to 6 mmHg (RMS); σ is √2 standard deviations.
SIGMA = 8 * ph.mmHg
GROUPS = ("control", "hypertensive")

DRAWS, CHAINS = 2000, 4  # draws in a chain, and number of chains
OUT = Path("results/pulmonary_hypertension")  # folder of the results
OUT.mkdir(parents=True, exist_ok=True)


def every_other_point(data: xr.Dataset, first: int) -> xr.Dataset:
    """Return the points `first`, `first` + 2, ... of every curve."""
    position = np.concatenate([np.arange(n) for n in np.bincount(data["test"])])
    return data.isel(obs=position % 2 == first)


# %%
# The data and the training data
# ------------------------------
# The slope weight gives slopes and pressures the same weight. It is computed once, from all data,
# because evidences can be compared only if the likelihood is the same.
data = ph.load_dataset("murine_pulmonary_artery")
likelihood = ph.SlopeAugmented(sigma=SIGMA, slope_weight=ph.balanced_slope_weight(data))
training = {name: ph.select(every_other_point(data, 0), group=name) for name in GROUPS}
new = every_other_point(data, 1).assign_attrs(title=f"points left out: {data.attrs['title']}")

figure = ph.plot_inflation(data, group_by=None, pressure_unit="mmHg")
figure.savefig(OUT / "data.png", dpi=150)

# %%
# Fit the classes, and classify the points left out
# -------------------------------------------------
fitted, results = {}, {}
for energy in (ph.PowerLawNeoHookean(), ph.Ogden(), ph.CriscioneType()):
    law = energy.name
    print(f"{law}: fitting {len(training)} classes, classifying the points left out")
    fitted[law] = ph.fit_classes(
        energy,
        training,
        likelihood,
        draws=DRAWS,
        chains=CHAINS,
        random_seed=1,
        progressbar=False,
    )
    fitted[law].to_netcdf(OUT / f"{law}_classes.nc")
    results[law] = ph.classify(new, fitted[law], random_seed=2, progressbar=False)
    results[law].to_netcdf(OUT / f"{law}_class_probability.nc")

# %%
# The numbers
# -----------
# Ogden's α and b of the Criscione-type law may be positive or negative: their posteriors have two
# mirrored modes. Therefore the table shows the mean of the absolute value. The reference of the
# parameters is the stretched state in the chamber, because the unloaded artery was not measured.
rows = []
for law, classes in fitted.items():
    for name, other in (GROUPS, GROUPS[::-1]):
        posterior = classes[name]["posterior"]
        values = {p: abs(posterior[p.name]) for p in ph.StrainEnergy.from_name(law).parameters}
        row = {"law": law, "class": name, "log evidence": str(ph.log_evidence(classes[name]))}
        row["|parameters|, mean ± sd"] = ", ".join(
            f"{p.name} {v.mean():.2f} ± {v.std():.2f} {p.unit}".strip() for p, v in values.items()
        )
        row["KL from the other class"] = f"{ph.kl_divergence(classes, name, other).value:.1f}"
        rows.append(row)
print(f"\n{data.attrs['title']}: {likelihood.in_words}")
print(pd.DataFrame(rows).to_string(index=False))

rows = []
for test in range(new.sizes["test"]):
    row = {"points left out of": new["group"].values[test]}
    for law, result in results.items():
        control, ill = (result.isel(test=test).sel(class_label=name) for name in GROUPS)
        row[law] = f"{ill.class_probability:.4f} ± {ill.class_probability_se:.4f}"
        row[law] += f" ({ill.log_evidence - control.log_evidence:+.1f})"
    rows.append(row)
print("\nProbability of hypertensive, and in brackets the logarithm of the ratio of evidences")
print(pd.DataFrame(rows).to_string(index=False))
print(
    "\nThe points left out belong to the two mean curves that trained the classes: classifying\n"
    "them checks the method. One mean curve a group says nothing about the differences between\n"
    "animals, nor whether a single new animal could be classified."
)

# %%
# The figures
# -----------
measured = {name: ph.select(data, group=name) for name in GROUPS}
for law, classes in fitted.items():
    ph.plot_parameter_density(classes).savefig(OUT / f"{law}_parameters.png", dpi=150)
    figure = ph.plot_fit(classes, measured, pressure_unit="mmHg")
    figure.savefig(OUT / f"{law}_fit.png", dpi=150)
ph.plot_class_probability(results).savefig(OUT / "class_probability.png", dpi=150)
print(f"\nFigures and netCDF files are in {OUT}/")
