"""
Inflation and a strip of one simulated vessel
=============================================

All data on this page are **simulated**. A vessel is inflated at its in vivo length, and a strip of
its wall is pulled along the hoop direction. The law is fitted to the inflation alone, to the strip
alone, and to both together. How much is learned from both, about the parameters and about an axial
stress that no test measured?

**Results.** With both tests the intervals of the parameters have 19 to 62 % of their width with the
inflation alone, and 7 to 48 % of that with the strip alone. The 95 % interval of the axial stress
is 76 to 261 kPa from the inflation alone and 96 to 122 kPa from both; the truth is 97 kPa. The
strip alone determines this stress only within a factor of 60, because the axial stretch in vivo is
far from its stretches. All intervals contain the truth. The evidence prefers one material for both
tests to two materials by 2.3 nats, as it should.

**Limits.** The law and the sizes of the errors are the true ones, and the strip and the tube have
the same material. A strip of a real vessel is cut from a wall with residual stress, and differs
from the rest of the wall. One vessel does not show how often the intervals contain the truth. The
vessel has the tube, and the parameters of matrix and diagonal fibres, of one mouse ascending aorta
(repository yale-humphrey-lab/gr-regression, single-group/C1041G_ATA_allspec.csv). Its axial fibres
are left out.
"""

# sphinx_gallery_thumbnail_number = 2

import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr

import pymc_hyperelastic as ph

DRAWS, CHAINS = 800, 2  # draws in a chain, and number of chains
OUT = Path("results/inflation_and_strip")  # folder of the results
OUT.mkdir(parents=True, exist_ok=True)
rng = np.random.default_rng(1)

# %%
# The simulated vessel
# --------------------
# The tube, its in vivo axial stretch, and the parameters of the matrix and of the diagonal fibres
# are those of the first of the seven aortas. The source prints the modulus 2 k₁ and the angle from
# the axis. The vessel here has no axial fibres, unlike that aorta.
LAW = ph.HolzapfelGasserOgden()
TRUTH = {"c": 13.44, "k1": 3.821, "k2": 0.5565, "beta": 39.77}  # kPa, kPa, 1, degrees
STRETCH = 1.604  # axial stretch in vivo
TUBE = ph.Tube(inner_radius=0.4762, outer_radius=0.6000, axial_stretch=STRETCH)  # mm
ERRORS = {"pressure_sd": 1 * ph.mmHg, "stress_sd": 2.0}  # standard deviations, kPa
truth = xr.DataTree.from_dict(
    {"posterior": xr.Dataset({n: (("chain", "draw"), [[v]]) for n, v in TRUTH.items()})}
)

# %%
# **Inflation** at the in vivo stretch, from 10 to 140 mmHg.
PRESSURES = np.linspace(10, 140, 14) * ph.mmHg
many = np.linspace(0.35, 1.0, 500)
curve = ph.inflation_pressure(LAW, many, TUBE, **TRUTH).eval()
frame = pd.DataFrame(
    {
        "specimen": "vessel",
        "experiment": "inflation",
        "radius": np.interp(PRESSURES, curve, many),
        "pressure": PRESSURES + ERRORS["pressure_sd"] * rng.standard_normal(PRESSURES.size),
    }
)
inflation = ph.inflation_data(frame, TUBE)

# %%
# **A strip** that was cut along the hoop direction. It is pulled along this direction, x, up to a
# stretch of 1.6, and free along the axis of the vessel, y.
stretch = np.linspace(1.05, 1.6, 12)
stress = ph.predict_stress(truth, stretch, energy=LAW)["stress_x"].values.ravel()
frame = pd.DataFrame(
    {
        "specimen": "vessel",
        "experiment": "strip",
        "stretch": stretch,
        "stress": stress + ERRORS["stress_sd"] * rng.standard_normal(stretch.size),
    }
)
strip = ph.sheet_data(frame, kind="uniaxial", stress="cauchy")

# %%
# Fit each test, and both together
# --------------------------------
# The medians of the priors are those of the seven aortas, rounded, but the priors are much wider
# than the differences between these aortas: a standard deviation of 1 of the logarithm is a factor
# of 7 in both directions for 95 %. The angle has its default prior, uniform from 0 to 90 degrees.
# With the defaults for all parameters, which are uniform up to 500 kPa for ``k1`` and 50 for
# ``k2``, the strip alone would say little. The errors are known.
PRIORS = {
    name: pm.LogNormal.dist(np.log(median), 1.0)
    for name, median in {"c": 13.0, "k1": 4.0, "k2": 0.4}.items()
}
studies = {
    "inflation": (inflation, ["pressure_sd"]),
    "strip": (strip, ["stress_sd"]),
    "both": (ph.combine_tests(inflation, strip), ["pressure_sd", "stress_sd"]),
}
fitted = {}
for name, (tests, errors) in studies.items():
    likelihood = ph.Gaussian(**{error: ERRORS[error] for error in errors})
    model = ph.material_model(LAW, tests.assign_attrs(simulated=1), likelihood, priors=PRIORS)
    fitted[name] = ph.sample_smc(model, DRAWS, CHAINS, random_seed=1, progressbar=False)

# %%
# What is learned
# ---------------
# The predicted quantity is the axial Cauchy stress of the wall in vivo, at the in vivo axial
# stretch and a hoop stretch of 1.5. No test measured an axial stress.
AXIAL = "axial stress, kPa"


def stresses(tree: xr.DataTree, x: np.ndarray | float, y: float | None = None) -> xr.Dataset:
    """Return draws of the stresses of the wall, also far from the stretches of the tests."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*outside")
        return ph.predict_stress(tree, x, y, energy=LAW)


def quantities(tree: xr.DataTree) -> dict[str, np.ndarray]:
    """Return draws of the parameters and of the axial stress."""
    found = stresses(tree, 1.5, STRETCH)["stress_y"]
    draws = {
        f"{p.name}, {p.unit}".removesuffix(", "): tree["posterior"][p.name].values.ravel()
        for p in LAW.parameters
    }
    return draws | {AXIAL: found.values.ravel()}


exact = {name: values[0] for name, values in quantities(truth).items()}
intervals = {
    study: {name: np.quantile(v, [0.025, 0.5, 0.975]) for name, v in quantities(tree).items()}
    for study, tree in fitted.items()
}
rows = []
for name, true in exact.items():
    row = {"quantity": name, "truth": f"{true:.3g}"}
    for study, ends in intervals.items():
        low, _, high = ends[name]
        row[study] = f"{low:.3g} to {high:.3g}{'' if low <= true <= high else ' (missed)'}"
    widths = {study: ends[name][2] - ends[name][0] for study, ends in intervals.items()}
    for study in ("inflation", "strip"):
        row[f"both / {study}"] = f"{widths['both'] / widths[study]:.2f}"
    rows.append(row)
print("SIMULATED vessel: 95 % intervals, and the ratios of their widths")
print(pd.DataFrame(rows).to_string(index=False))

# %%
# Does one material explain both tests? The evidence of one material for both is compared with that
# of two materials, one for each test, which is the product of the two evidences.
evidences = {study: ph.log_evidence(tree) for study, tree in fitted.items()}
for study, evidence in evidences.items():
    verdict = ph.diagnose_evidence(fitted[study]).attrs["verdict"]
    print(f"{study}: log evidence {evidence}, {verdict}")
(both, e1), (alone, e2), (other, e3) = (evidences[s] for s in ("both", "inflation", "strip"))
error = np.sqrt(e1**2 + e2**2 + e3**2)
print(f"log Bayes factor, one material over two: {both - alone - other:.2f} ± {error:.2f}")

# %%
# The figures
# -----------
# What each test predicts for the strip: lines are medians, bands are 95 % intervals of the stress.
figure, axes = plt.subplots(1, 2, figsize=(7, 3.5), layout="constrained")
axes[0].plot(inflation["radius"], inflation["pressure"] / ph.mmHg, "ko", ms=4)
for study, colour in (("inflation", "C0"), ("both", "C2")):
    radius = np.linspace(*inflation["radius"].quantile([0, 1]).values, 60)
    found = ph.predict_pressure(fitted[study], radius)["pressure"] / ph.mmHg
    low, middle, high = found.quantile([0.025, 0.5, 0.975], ("chain", "draw")).values
    axes[0].fill_between(radius, low, high, color=colour, alpha=0.3, lw=0)
    axes[0].plot(radius, middle, color=colour)
    along = np.linspace(1, 1.6, 30)
    found = stresses(fitted[study], along)["stress_x"]
    low, middle, high = found.quantile([0.025, 0.5, 0.975], ("chain", "draw")).values
    axes[1].fill_between(along, low, high, color=colour, alpha=0.3, lw=0)
    axes[1].plot(along, middle, color=colour, label=f"fitted to {study}")
axes[1].plot(strip["stretch_x"], strip["stress_x"], "ko", ms=4, label="measured")
axes[0].set(title="inflation", xlabel="internal radius (mm)", ylabel="pressure (mmHg)")
axes[1].set(title="strip", xlabel="hoop stretch", ylabel="hoop stress (kPa)")
axes[1].legend(fontsize="small")
figure.suptitle("SIMULATED vessel")
figure.savefig(OUT / "tests.png", dpi=150)

# %%
# Medians and 95 % intervals of all quantities. The dashed lines are the true values.
figure, axes = plt.subplots(len(exact), 1, figsize=(6, 6.5), layout="constrained")
for ax, (name, true) in zip(axes, exact.items(), strict=True):
    for study, ends in intervals.items():
        low, middle, high = ends[name]
        ax.errorbar(
            middle, study, xerr=[[middle - low], [high - middle]], fmt="o", color="k", capsize=3
        )
    ax.axvline(true, color="C1", ls="--")
    ax.set_xlabel(name)
    ax.invert_yaxis()
    ax.set_xscale("log" if name == AXIAL else "linear")
    ax.margins(y=0.3)
axes[0].set_title("SIMULATED vessel")
figure.savefig(OUT / "intervals.png", dpi=150)
print(f"\nThe figures are in {OUT}/")
