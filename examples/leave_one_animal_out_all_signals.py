"""
Leave one animal out, with all measurements
===========================================

This example uses the sixteen **measured** vaginal walls of :doc:`leave_one_animal_out`, before and
after elastase, with all measurements: three inflation and four extension tests, pressures and axial
forces. The model has fibres in the wall, and a thickness with a measurement error. Each specimen is
classified with classes that were fitted to the other seven mice.

**Choices made before the run:**

- Points of inflation tests below 3.5 mmHg are left out: the wall is still folded there.
- The thickness of each specimen is inferred. Controls 1 to 4 have one common measured value. So do
  controls 5 to 8 and the treated specimens 1 to 3. The thickness of the other five specimens was
  measured individually. The error of an individual value has a standard deviation of 0.02 mm. The
  error of a common value has the standard deviation between the five individual values, 0.084 mm.
- The standard deviations of the errors of pressure and force are inferred for each specimen; the
  priors of their medians over a class are 1 mmHg and 1 mN within a factor of ten. Each test has an
  unknown offset of the force transducer with a standard deviation of 20 mN, which is integrated
  out.
- The laws are those of Ogden, and of Holzapfel, Gasser and Ogden, weighted by the evidences of the
  other animals. All other settings are defaults; experiments on one specimen share its material.

**Limits.** A coin toss has a log score of −0.69. Eight animals are few: the standard error of the
mean score is printed too.

**Results.** For every animal, the evidence of the other animals prefers the law with fibres. Its
mean log score is −0.64 ± 0.17, that of a coin toss within its standard error; Ogden's law has −0.54
± 0.13. With inflation tests alone, the preferred law, the Criscione-type, had −0.73, and Ogden's
law −0.68. The page :doc:`/project/probabilities` discusses the reasons.

The measurements are those of A. R. Akintunde et al., Journal of Biomechanical Engineering 141
(2019) 021011. They are not part of this package. The module :download:`murine_tables.py` reads
them. Save it beside this script; it states where it looks for the tables.
"""

# sphinx_gallery_thumbnail_path = "stored/leave_one_animal_out_all_signals/true_class.png"

from pathlib import Path

import matplotlib.pyplot as plt
import murine_tables
import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr

import pymc_hyperelastic as ph

DRAWS = 1000
LAWS = ["Ogden", "HolzapfelGasserOgden"]
KNOWN_THICKNESS = False  # if True, thicknesses are exact
OUT = Path("results/all_signals")  # folder of the results
OUT.mkdir(parents=True, exist_ok=True)

# %%
# The specimens
# -------------
data, geometry = murine_tables.read(extended=True)
thickness = geometry.set_index("specimen")["thickness_unloaded_mm"]
shared = thickness.duplicated(keep=False)
OF_BATCH, OF_ONE = thickness[~shared].std(), 0.02  # mm
sd = [OF_BATCH if shared[name] else OF_ONE for name in data["specimen"].values]
data = data.assign(thickness_sd=("test", sd))
groups = {name: ph.select(data, group=name) for name in ("control", "elastase")}
animals = dict(zip(geometry["specimen"], geometry["animal"], strict=True))

# %%
# The report
# ----------
FACTOR_TEN = np.log(10) / 2
report = ph.cross_validate(
    [getattr(ph, name)() for name in LAWS],
    groups,
    ph.Gaussian(
        pressure_sd=pm.LogNormal.dist(np.log(ph.mmHg), FACTOR_TEN),
        force_sd=pm.LogNormal.dist(np.log(1.0), FACTOR_TEN),
        force_offset_sd=20.0,
    ),
    priors=None if KNOWN_THICKNESS else {"thickness": ph.MeasuredValue()},
    leave_out=animals,
    draws=DRAWS,
    random_seed=1,
)
report.to_netcdf(OUT / "report.nc")

# %%
# The table
# ---------
# The tables show the natural logarithm of the probability of the true class, and the verdict on its
# reliability.
table = report["log_score"].transpose("specimen", ...).to_pandas()
rows = len(table)
table.loc["mean"] = table.iloc[:rows].mean()
table.loc["standard error"] = table.iloc[:rows].sem()
table.loc["right"] = (table.iloc[:rows] > np.log(0.5)).sum()
pd.options.display.width = 200
print("ln P(true class), each specimen by the other animals\n")
print(table.round(2).to_string())
print("\nverdicts")
print(report["verdict"].transpose("specimen", ...).to_pandas().to_string())
if "strain_energy_probability" in report:
    print("\nprobability of each law, by the other animals")
    print(report["strain_energy_probability"].to_pandas().round(3).to_string())
table.to_csv(OUT / "log_score.csv")

# %%
# Every specimen
# --------------
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
truth = xr.DataArray(report["true_class"].values, dims="specimen")
for number, law in enumerate(report["strain_energy"].values):
    chance = report["class_probability"].sel(strain_energy=law).sel(class_label=truth)
    place = np.arange(rows) + 0.15 * (number - 1)
    axes.plot(place, chance, "o", label=law)
axes.axhline(0.5, color="grey", linewidth=0.8)
axes.set_xticks(np.arange(rows), report["specimen"].values, rotation=60, ha="right")
axes.set(ylabel="probability of the true class", ylim=(-0.02, 1.02))
figure.legend(loc="outside upper center", ncols=4, fontsize="small")
figure.savefig(OUT / "true_class.png", dpi=120)
print(f"\nTables and figures are in {OUT}/")
