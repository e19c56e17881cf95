"""
Before and after: the effect of elastase on a wall, animal by animal
====================================================================

Sixteen **measured** vaginal walls of eight mice, each before and after elastase, were tested with
seven protocols. Which properties differ, by how much, and with what probability? Each animal is its
own control. For comparison, the two groups are also compared as if they were different animals.

Laws, noise, thickness and their priors are those of :doc:`leave_one_animal_out_all_signals`. They
were chosen before any result was known. So were the quantities, which laboratories usually report,
at 7 mmHg and an axial stretch of 1.2.

**Limits.** Each quantity is compared separately, without a correction for their number. Eight
animals determine the size of a common effect, but hardly the classification of a single new
specimen. The comparison is one of materials, in one tube: a change of the unloaded thickness is not
included. If a specimen was mounted again after the treatment, differences of the set-up are part of
the change.

**Results.** Axial stress, axial stiffness and stored energy fell in most animals. In the
circumferential direction no change was found, but a change of a quarter or more is not excluded.
Only the 95 % interval of the axial stress excludes zero, and the log Bayes factor of "different"
over "the same" is −0.3 ± 0.2: eight animals do not decide. If the animals are treated as different
ones, the intervals are wider.

The measurements are those of A. R. Akintunde et al., Journal of Biomechanical Engineering 141
(2019) 021011. They are not part of this package. The module :download:`murine_tables.py` reads
them. Save it beside this script; it states where it looks for the tables.
"""

# sphinx_gallery_thumbnail_path = "stored/before_and_after/the_same_animals.png"

from pathlib import Path

import murine_tables
import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr

import pymc_hyperelastic as ph

DRAWS = 1000
LAWS = ["Ogden", "HolzapfelGasserOgden"]
OUT = Path("results/before_and_after")  # folder of the results
OUT.mkdir(parents=True, exist_ok=True)

# %%
# The specimens, and the classes
# ------------------------------
data, geometry = murine_tables.read(extended=True)
thickness = geometry.set_index("specimen")["thickness_unloaded_mm"]
shared = thickness.duplicated(keep=False)
sd = [thickness[~shared].std() if shared[n] else 0.02 for n in data["specimen"].values]
data = data.assign(thickness_sd=("test", sd))
animals = dict(zip(geometry["specimen"], geometry["animal"], strict=True))
FACTOR_TEN = np.log(10) / 2
SETTINGS = {
    "likelihood": ph.Gaussian(
        pressure_sd=pm.LogNormal.dist(np.log(ph.mmHg), FACTOR_TEN),
        force_sd=pm.LogNormal.dist(np.log(1.0), FACTOR_TEN),
        force_offset_sd=20.0,
    ),
    "priors": {"thickness": ph.MeasuredValue()},
    "variability": "specimen",
}
groups = {name: ph.select(data, group=name) for name in ("control", "elastase")}
classes = {}
for name in LAWS:
    stored = OUT / f"{name}.nc"
    if not stored.exists():
        fitted = ph.fit_classes(
            getattr(ph, name)(),
            groups,
            draws=DRAWS,
            chains=2,
            random_seed=1,
            **SETTINGS,
        )
        fitted.to_netcdf(stored)
    classes[name] = xr.load_datatree(stored)
print("Log evidence of both groups together")
for name, fitted in classes.items():
    print(f"  {name}: {sum(ph.log_evidence(tree).value for tree in fitted.children.values()):.1f}")

# %%
# The comparison
# --------------
QUANTITIES = [
    "log compliance",
    "log circumferential_material_stiffness",
    "log axial_material_stiffness",
    "log circumferential_stress",
    "log axial_stress",
    "log stored_energy",
    "radius",
]
AT = ph.Conditions(7.0, pressure_unit="mmHg", tube=ph.Tube(axial_stretch=1.2))


def table_of(compared: xr.Dataset) -> pd.DataFrame:
    """Return a table of the typical specimens, or of the typical change."""
    typical = compared.sel(statistic="typical").squeeze("comparison")
    columns = {
        "difference": typical["difference"],
        "low": typical["difference_interval"].sel(bound="low"),
        "high": typical["difference_interval"].sel(bound="high"),
        "P(rises)": typical["probability_of_rise"],
        "effect size": typical["effect_size"],
        "accuracy": typical["best_accuracy"],
        "prior": typical["prior_sensitivity"],
        "likelihood": typical["likelihood_sensitivity"],
        "lacking": typical["lacking"].max("group"),
    }
    if "share_rising" in typical:
        columns["rises in"] = typical["share_rising"]
    return pd.DataFrame(columns, index=typical["quantity"].values)


pd.options.display.width = 200
pd.options.display.max_columns = 20
ways = {"the same animals": {"pair": animals}, "as if others": {}}
for words, how in ways.items():
    compared = ph.compare_classes(classes, QUANTITIES, at=AT, random_seed=1, **how)
    name = words.replace(" ", "_")
    compared.to_netcdf(OUT / f"{name}.nc")
    table = table_of(compared)
    table.to_csv(OUT / f"{name}.csv")
    factor, error = compared["log_bayes_factor"].item(), compared["log_bayes_factor_se"].item()
    print(f"\nElastase less control, {words}: log Bayes factor {factor:.1f} ± {error:.1f}")
    print(table.round(2).to_string())
    print(compared.attrs["words"])
    ph.plot_comparison(compared).savefig(OUT / f"{name}.png", dpi=150)
print(f"\nTables, figures and netCDF files are in {OUT}/")
