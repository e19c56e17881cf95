"""
Leave one animal out: reliable class probabilities
==================================================

Can inflation curves alone distinguish vaginal walls with and without elastase treatment? The tubes
of eight mice were **measured** before and after elastase. Each is classified with classes that were
fitted to the other seven mice. Both states of an animal are left out together.

In the paper's pooled scheme all specimens of a class share one set of parameters. Real specimens
differ, so more measurements make this scheme more certain, also if its answer is wrong. With
variability, each specimen has its own parameters, drawn from a distribution of its class.

**Limits.** A coin toss has a log score of −0.69. Eight animals are few: the standard error of the
mean score is printed too. The laws are weighted by the evidences of the other animals, and the
priors are the defaults. The differences between experiments on a specimen were added to the model
after these data had been seen. No number was adjusted to improve the score.

The measurements are those of A. R. Akintunde et al., Journal of Biomechanical Engineering 141
(2019) 021011. They are not part of this package. The module :download:`murine_tables.py` reads
them. Save it beside this script; it states where it looks for the tables.
"""

# sphinx_gallery_thumbnail_path = "stored/leave_one_animal_out/true_class.png"

from pathlib import Path

import matplotlib.pyplot as plt
import murine_tables
import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr

import pymc_hyperelastic as ph

DRAWS = 1000
OUT = Path("results/leave_one_animal_out")  # folder of the results
OUT.mkdir(parents=True, exist_ok=True)

# %%
# The specimens and their animals
# -------------------------------
# The stress-free tube is the opened ring. Points below 3.5 mmHg are left out, because the wall is
# still folded there.
data, geometry = murine_tables.read()
groups = {name: ph.select(data, group=name) for name in ("control", "elastase")}
animals = dict(zip(geometry["specimen"], geometry["animal"], strict=True))

# %%
# Pooled, and with variability
# ----------------------------
# The pooled classes have a fixed noise of 2 mmHg. With variability the noise of each specimen is
# inferred; the prior of its median over a class is 1 mmHg within a factor of ten.
LAWS = [ph.PowerLawNeoHookean(), ph.Ogden(), ph.CriscioneType()]
settings = {
    "leave_out": animals,
    "random_seed": 1,
}
pooled = ph.cross_validate(
    LAWS,
    groups,
    ph.Gaussian(pressure_sd=2 * ph.mmHg),
    variability=None,
    draws=DRAWS,
    **settings,
)
population = ph.cross_validate(
    LAWS,
    groups,
    ph.Gaussian(pressure_sd=pm.LogNormal.dist(np.log(ph.mmHg), np.log(10) / 2)),
    variability=ph.Variability(experiment_effect=True),
    draws=DRAWS,
    **settings,
)
for name, report in {"pooled": pooled, "population": population}.items():
    report.to_netcdf(OUT / f"{name}.nc")

# %%
# The table
# ---------
# The table shows the natural logarithm of the probability of the true class.
scores = {
    (scheme, law): report["log_score"].sel(strain_energy=law).to_series()
    for scheme, report in {"pooled": pooled, "population": population}.items()
    for law in report["strain_energy"].values
}
table = pd.DataFrame(scores)
table.loc["mean"] = table.mean()
table.loc["standard error"] = table.iloc[:-1].sem()
table.loc["right"] = (table.iloc[:-2] > np.log(0.5)).sum()
pd.options.display.width = 200
print("ln P(true class), each specimen by the other animals\n")
print(table.round(2).to_string())
print("\nprobability of each law, by the other animals")
laws = population["strain_energy_probability"].sel(strain_energy=[law.name for law in LAWS])
print(laws.transpose("specimen", ...).to_pandas().round(3).to_string())
table.to_csv(OUT / "log_score.csv")

# %%
# How reliable the probabilities are
# ----------------------------------
average = population.sel(strain_energy="average")
result = ph.score_probabilities(average["class_probability"], average["true_class"].values)
ph.plot_reliability(result).savefig(OUT / "reliability.png")

# %%
# Every specimen
# --------------
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
place = np.arange(population.sizes["specimen"])
truth = xr.DataArray(population["true_class"].values, dims="specimen")
for shift, (name, report) in zip((-0.15, 0.15), (("pooled", pooled), ("population", population))):
    chance = report["class_probability"].sel(strain_energy="average").sel(class_label=truth)
    axes.plot(place + shift, chance, "o", label=f"{name}, averaged over the laws")
axes.axhline(0.5, color="grey", linewidth=0.8)
axes.set_xticks(place, population["specimen"].values, rotation=60, ha="right")
axes.set(ylabel="probability of the true class", ylim=(-0.02, 1.02))
figure.legend(loc="outside upper center", ncols=2, fontsize="small")
figure.savefig(OUT / "true_class.png", dpi=120)
print(f"\nTables and figures are in {OUT}/")
