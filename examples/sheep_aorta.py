"""
Sheep aortas: which class does a new experiment belong to?
==========================================================

The whole study on **simulated** data: nothing here was measured. Five aortas in two classes, C1
and C2, are inflated three times each. Experiments 1 and 2 train the classes; experiment 3 of each
aorta is new and is classified. Three strain energies do the same job, to be compared.

All specimens of a class share one set of parameters here, as in the paper. Probabilities are then
surer of themselves than the differences between specimens allow.
"""

from pathlib import Path

import pandas as pd
import xarray as xr

import pymc_hyperelastic as ph

# Specimens of a class scatter by some 10 mmHg at high pressure, as a standard deviation; σ is √2 of
# it.
SIGMA = 15 * ph.mmHg

DRAWS, CHAINS = 2000, 4  # particles of a chain, and independent runs
OUT = Path("results/sheep_aorta")  # where results go
OUT.mkdir(parents=True, exist_ok=True)

# %%
# The data, and what trains the classes
# -------------------------------------
# The slope weight makes errors of slope and of pressure weigh alike. It is computed once, from all
# data: evidences of classes can only be compared under one likelihood.
data = ph.load_dataset("simulated_sheep_aorta")
likelihood = ph.SlopeAugmented(sigma=SIGMA, slope_weight=ph.balanced_slope_weight(data))
training = {name: ph.select(data, group=name, experiment=[1, 2]) for name in ("C1", "C2")}
new = ph.select(data, experiment=3)

ph.plot_inflation(data, pressure_unit="mmHg").savefig(OUT / "data.png", dpi=150)

# %%
# Fit the classes, and classify the new experiments
# -------------------------------------------------
# Fitted classes are stored and read back: what is in the file classifies the new experiments.
fitted, results = {}, {}
for energy in (ph.PowerLawNeoHookean(), ph.Ogden(), ph.CriscioneType()):
    law = energy.name
    print(f"{law}: fitting {len(training)} classes, classifying {new.sizes['test']} experiments")
    classes = ph.fit_classes(
        energy,
        training,
        likelihood,
        draws=DRAWS,
        chains=CHAINS,
        random_seed=1,
        progressbar=False,
    )
    classes.to_netcdf(OUT / f"{law}_classes.nc")
    fitted[law] = xr.load_datatree(OUT / f"{law}_classes.nc")

    results[law] = ph.classify(new, fitted[law], random_seed=2, progressbar=False)
    results[law].to_netcdf(OUT / f"{law}_class_probability.nc")

# %%
# The numbers
# -----------
# Ogden's α and the Criscione-type law's b may have either sign: their posteriors have two mirrored
# modes, and the absolute value is what has a mean.
rows = []
for law, classes in fitted.items():
    for name, other in (("C1", "C2"), ("C2", "C1")):
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
    row = {name: new[name].values[test] for name in ("specimen", "experiment", "group")}
    for law, result in results.items():
        c1, c2 = (result.isel(test=test).sel(class_label=name) for name in ("C1", "C2"))
        row[law] = f"{c1.class_probability:.4f} ± {c1.class_probability_se:.4f}"
        row[law] += f" ({c1.log_evidence - c2.log_evidence:+.1f})"
    rows.append(row)
print("\nProbability of C1, and in brackets the logarithm of the ratio of evidences, C1 over C2")
print(pd.DataFrame(rows).to_string(index=False))

# %%
# The figures
# -----------
for law, classes in fitted.items():
    ph.plot_parameter_density(classes).savefig(OUT / f"{law}_parameters.png", dpi=150)
    figure = ph.plot_fit(classes, pressure_unit="mmHg")
    figure.savefig(OUT / f"{law}_fit.png", dpi=150)
ph.plot_class_probability(results).savefig(OUT / "class_probability.png", dpi=150)
print(f"\nFigures and netCDF files are in {OUT}/")
