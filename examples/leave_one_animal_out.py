"""
Leave one animal out: probabilities of class that can be trusted
================================================================

Is a vaginal wall that was treated with elastase told from one that was not, by its inflation curves
alone? Each of these **measured** tubes, of eight mice before and after elastase, is classified by
those of the other seven mice; both states of an animal are left out together.

In the paper's scheme all specimens of a class share one set of parameters. Real ones do not, and
the more is measured, the surer that scheme gets of answers that are wrong. With variability each
specimen has its own parameters, drawn from a distribution of its class.

**What this can and cannot show.** A score of −0.69 is that of a coin. Eight animals are few: the
standard error of the mean score is printed beside it. Strain energies are weighed by the evidence
of the other animals alone, and priors are the package's defaults. That experiments on a specimen
differ, and more so on some specimens than on others, was put into the model after these very data
had been looked at; no number was adjusted to the score.

The measurements are those of A. R. Akintunde et al., Journal of Biomechanical Engineering 141
(2019) 021011. They are not part of this package. They are read by :download:`murine_tables.py`,
which has to lie beside this script and says where it looks for the tables.
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
OUT = Path("results/leave_one_animal_out")  # where results go
OUT.mkdir(parents=True, exist_ok=True)

# %%
# The specimens, and the animals that they are of
# -----------------------------------------------
# The tube that is free of stress is the cut ring, sprung open. Points below 3.5 mmHg are left out:
# there the wall, which lies folded at rest, is unfolding.
data, geometry = murine_tables.read()
groups = {name: ph.select(data, group=name) for name in ("control", "elastase")}
animals = dict(zip(geometry["specimen"], geometry["animal"], strict=True))

# %%
# Pooled, and with variability
# ----------------------------
# The pooled classes have the noise of the gauge, 2 mmHg; there is no other place for what a class's
# specimens do not share. With variability the noise of each specimen is inferred, its median over a
# class within a factor of ten of 1 mmHg.
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
# Natural logarithm of the probability of the true class.
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
