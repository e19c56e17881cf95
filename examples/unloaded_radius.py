"""
An unloaded radius that was not measured
========================================

The data are two mean curves of mouse left pulmonary arteries, control and with hypoxic pulmonary
hypertension: measured outer diameter against pressure, 11 points each, at an axial stretch of 1.4.
The unloaded radius of the artery is not known. It is inferred together with the material for four
laws, which are compared by their evidence. Then every other pressure is left out, and the outer
diameter there is predicted.

**Limits.** The data determine the unloaded radius only through the stretch at which a law stiffens.
The inferred radius is the radius *given the law*, and different laws may give radii that differ by
more than their uncertainties. A point that was left out has neighbours at a distance of 5 mmHg on
the same mean curve. Its error shows how well a law describes the curve, and gives no information
about other animals. The reference is a straight line between the neighbours.
"""

# sphinx_gallery_thumbnail_path = "stored/unloaded_radius/radius.png"

import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr

import pymc_hyperelastic as ph

AXIAL_STRETCH = 1.4
# Cross-section of the wall at that stretch, µm², from the thickness measured at three pressures.
WALL_AREA = {"control": (62153, 56622, 56815), "hypertensive": (85294, 86902, 88949)}

DRAWS, CHAINS = 300, 2  # draws in a chain, and number of chains
OUT = Path("results/unloaded_radius")  # folder of the results
OUT.mkdir(parents=True, exist_ok=True)
rng = np.random.default_rng(3)

# %%
# The data
# --------
# The reference of the shipped dataset is the mounted artery. The measured quantity was the outer
# diameter; it follows from the constant area of the wall. The data are built again from the outer
# diameter, with unknown radii of the unloaded artery.
shipped = ph.load_dataset("murine_pulmonary_artery")
of_point = shipped.isel(test=shipped["test"])
wall = of_point["outer_radius"] ** 2 - of_point["inner_radius"] ** 2
frame = pd.DataFrame(
    {
        "group": of_point["group"],
        "specimen": of_point["specimen"],
        "experiment": of_point["experiment"],
        "outer_diameter": 2 * np.sqrt(shipped["radius"] ** 2 + wall),
        "pressure": shipped["pressure"],
    }
)
data = ph.inflation_data(frame, ph.Tube(axial_stretch=AXIAL_STRETCH), measured="outer_diameter")

# %%
# Assumptions
# -----------
# The prior of the unloaded inner radius is uniform from 0.1 to 0.5 mm; the stretched radius without
# pressure was 0.20 to 0.23 mm. The wall keeps its volume: the unloaded cross-section is 1.4 times
# the measured one, with the standard deviation of the three measurements. The errors are errors of
# pressure, and their size is inferred. Most of it is the misfit of the laws: 2 to 5 mmHg for the
# controls, and 2 mmHg or less for the other curve. Slopes are not used, because they would need the
# points that are left out.
#
# All priors are the defaults, except that of the stiffening of the fibres. It multiplies the fourth
# power of the stretches, which exceed 2 in the control: values above 5 are not plausible.
LAWS = {
    ph.PowerLawNeoHookean(): {},
    ph.Ogden(): {},
    ph.CriscioneType(): {},
    ph.HolzapfelGasserOgden(): {"k2": pm.Uniform.dist(0, 5)},
}


def fit(energy: ph.StrainEnergy, curve: xr.Dataset) -> xr.DataTree:
    """Sample the posterior of the material, the unloaded tube and the size of the errors."""
    area = 1e-6 * AXIAL_STRETCH * np.array(WALL_AREA[curve["group"].item()])
    model = ph.inflation_model(
        energy,
        curve,
        ph.Gaussian(pressure_sd=pm.HalfNormal.dist(5 * ph.mmHg)),
        priors=LAWS[energy]
        | {
            "inner_radius": pm.Uniform.dist(0.1, 0.5),
            "wall_area": pm.Normal.dist(area.mean(), area.std(ddof=1)),
        },
    )
    return ph.sample_smc(model, DRAWS, CHAINS, 1)


def predicted_diameter(tree: xr.DataTree, pressure: np.ndarray) -> list[np.ndarray]:
    """Return the outer diameter (µm) at pressures (kPa): median, and 95 % interval of measurements.

    A pressure error changes the inner radius by error / stiffness. The area of the wall is
    constant, so the outer radius changes by inner / outer of that. Draws that do not reach a
    pressure are left out there.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "of .* draws .* do not reach")
        inflated = ph.tube_properties(tree, pressure)
    sd = tree["posterior"]["pressure_sd"]
    error = sd * sd.copy(data=rng.normal(size=sd.shape))
    outer = inflated["outer_radius"]
    measured = outer + inflated["radius"] / (outer * inflated["stiffness"]) * error
    low, high = measured.quantile([0.025, 0.975], dim=("chain", "draw")).values
    return [2e3 * radius for radius in (outer.median(dim=("chain", "draw")).values, low, high)]


# %%
# Fit all points, then every other point
# --------------------------------------
fitted, trained = {}, {}
for energy in LAWS:
    for group in WALL_AREA:
        print(f"{energy.name}, {group}: all points, then every other one")
        curve = ph.select(data, group=group)
        fitted[energy.name, group] = fit(energy, curve)
        fitted[energy.name, group].to_netcdf(OUT / f"{energy.name}_{group}.nc")
        trained[energy.name, group] = fit(energy, curve.isel(obs=slice(0, None, 2)))

# %%
# Evidence, and the unloaded radius
# ---------------------------------
# The evidences of one group compare the laws: all laws have the same data, errors and tube. A wide
# prior lowers the evidence of a law. The verdict states whether an evidence can be trusted: eleven
# points hardly determine six or seven unknowns, and such a posterior is a bent ridge. With 300
# draws some evidences are doubtful, and one is not to be trusted. More draws would be needed to
# rely on differences of less than one nat.
rows = []
for (law, group), tree in fitted.items():
    posterior = tree["posterior"]
    radius = 1e3 * posterior["inner_radius"]
    low, high = radius.quantile([0.025, 0.975]).values
    error = posterior["pressure_sd"] / ph.mmHg
    rows.append(
        {
            "group": group,
            "law": law,
            "log evidence": str(ph.log_evidence(tree)),
            "verdict": ph.diagnose_evidence(tree).attrs["verdict"],
            "unloaded inner radius, µm": f"{radius.mean():.0f} ± {radius.std():.0f}",
            "95 %": f"{low:.0f} to {high:.0f}",
            "error, mmHg": f"{error.mean():.1f} ± {error.std():.1f}",
        }
    )
print(f"\n{shipped.attrs['title']}: all points")
print(pd.DataFrame(rows).sort_values("group", kind="stable").to_string(index=False))

# %%
# The points left out
# -------------------
# Each law is fitted at 0, 10, ... 50 mmHg, and predicts the outer diameter at 5, 15, ... 45 mmHg.
rows = []
for group in WALL_AREA:
    curve = ph.select(data, group=group)
    known, left_out = (curve.isel(obs=slice(first, None, 2)) for first in (0, 1))
    pressure, measured = left_out["pressure"].values, 1e3 * left_out["outer_diameter"].values
    line = np.interp(pressure, known["pressure"], 1e3 * known["outer_diameter"])
    answers = {"(straight lines)": (line, "", "")}
    for energy in LAWS:
        middle, low, high = predicted_diameter(trained[energy.name, group], pressure)
        inside = (low <= measured) & (measured <= high)
        width = f"{(high - low).mean():.0f}"
        answers[energy.name] = middle, f"{inside.sum()} of {inside.size}", width
    for law, (answer, inside, width) in answers.items():
        error = np.abs(answer - measured)
        row = {"group": group, "law": law, "mean error, µm": error.mean(), "largest": error.max()}
        rows.append(row | {"in the 95 % interval": inside, "its mean width": width})
print("\nOuter diameter at the points left out")
print(pd.DataFrame(rows).to_string(index=False, float_format="{:.0f}".format))

# %%
# The figures
# -----------
# Lines are medians; the bands should contain 95 % of the measurements. The laws were fitted to the
# filled points only. Six points that a law does not fit well do not determine the size of the
# errors, so the bands are wide: where the curve is soft, a few mmHg correspond to 0.1 mm.
pressures = np.linspace(0, 50, 26) * ph.mmHg
laws = [energy.name for energy in LAWS]
colours = {law: f"C{number}" for number, law in enumerate(laws)}
figure, axes = plt.subplots(
    2, len(laws), figsize=(12, 6.5), sharex=True, sharey="row", layout="constrained"
)
for row, group in zip(axes, WALL_AREA, strict=True):
    curve = ph.select(data, group=group)
    for ax, law in zip(row, laws, strict=True):
        middle, low, high = predicted_diameter(trained[law, group], pressures)
        ax.fill_between(pressures / ph.mmHg, low, high, color=colours[law], alpha=0.25, lw=0)
        ax.plot(pressures / ph.mmHg, middle, color=colours[law])
        for first, filled, label in ((0, "k", "trained on"), (1, "w", "left out")):
            points = curve.isel(obs=slice(first, None, 2))
            x, y = points["pressure"] / ph.mmHg, 1e3 * points["outer_diameter"]
            ax.plot(x, y, "o", mfc=filled, mec="k", ms=5, label=label)
        ax.set_title(law if group == "control" else "")
    measured = 1e3 * curve["outer_diameter"].values
    row[0].set(ylabel=f"{group}\nouter diameter (µm)", ylim=(measured[0] - 200, measured[-1] + 250))
axes[0, 0].legend(loc="upper left")
figure.supxlabel("pressure (mmHg)")
figure.savefig(OUT / "left_out.png", dpi=150)

# %%
# The figure shows the posterior of the radius for each law, given all points, and the uniform
# prior. The radius of an isotropic tube that is stretched without pressure is smaller than the
# unloaded radius by the square root of the stretch: this gives the dotted line, from the point at 0
# mmHg alone.
figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True, layout="constrained")
for ax, group in zip(axes, WALL_AREA, strict=True):
    for law in laws:
        radius = 1e3 * fitted[law, group]["posterior"]["inner_radius"].values.ravel()
        ax.hist(
            radius, np.arange(100, 501, 10), density=True, histtype="step", color=colours[law],
            lw=1.5, label=law,
        )  # fmt: skip
    ax.axhline(1 / 400, color="0.6", lw=1, label="prior")
    at_rest = 1e3 * shipped["inner_radius"].values[list(WALL_AREA).index(group)]
    ax.axvline(np.sqrt(AXIAL_STRETCH) * at_rest, color="k", ls=":", label="isotropic, at rest")
    ax.set(title=group, xlabel="unloaded inner radius (µm)", yticks=[])
axes[0].set_ylabel("posterior density")
axes[1].legend(fontsize="small")
figure.savefig(OUT / "radius.png", dpi=150)

figure, axes = plt.subplots(1, 2, figsize=(9, 2.6), sharey=True, layout="constrained")
for ax, group in zip(axes, WALL_AREA, strict=True):
    evidences = [ph.log_evidence(fitted[law, group]) for law in laws]
    values, errors = np.array(evidences).T
    for value, error, law in zip(values - values.max(), errors, laws, strict=True):
        trusted = np.isfinite(error)
        ax.errorbar(
            value, law, xerr=2 * error if trusted else None, fmt="o", color="k",
            mfc="k" if trusted else "w", capsize=3,
        )  # fmt: skip
    ax.set(title=group, xlabel="log evidence, less that of the best law")
    ax.grid(axis="x", alpha=0.4)
axes[0].invert_yaxis()
figure.savefig(OUT / "evidence.png", dpi=150)
print(f"\nFigures and netCDF files are in {OUT}/")
