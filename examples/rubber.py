"""
Rubber: does one test predict the others?
=========================================

The data are Treloar's measured tests of one vulcanised rubber (1944). Seven laws are fitted to the
uniaxial test, and predict the equibiaxial test and pure shear. Beside each posterior is the usual
fit by least squares of the same law.

**Results.** The evidence prefers the laws of Gent and of Lopez-Pamies. They fit the uniaxial test
with an error of 1.2 % of its largest stress. They predict pure shear with 6.3 % and 3.2 %. The
equibiaxial stress is 10 % too low, and only 6 and 9 of the 16 measurements lie in the 95 %
intervals: these are too narrow. The intervals of least squares contain even fewer measurements, 5
and 7. If the uniaxial test determines all parameters of a law, both ways have nearly the same
errors. It hardly determines the second modulus of the Mooney-Rivlin law. Least squares make this
modulus negative, and the equibiaxial stress is wrong by 23 times its largest value. With a prior
that keeps both moduli positive, the error is 76 %, and the interval is so wide that it contains all
measurements.

**Limits.** An interval contains the errors of measurement and of the parameters, not the error of
the law in another kind of test. The model has independent errors of one size, but the misfit of a
law has the same sign at neighbouring points. The evidence only compares the laws in the test that
was fitted: the law with the highest evidence does not predict best. Fit all tests that
are at hand, and predict only what lies between them.

**Literature.** P. Steinmann, M. Hossain and G. Possart (*Archive of Applied Mechanics* 82 (2012)
1183-1217) fitted laws of rubber to one of Treloar's tests and compared them with the others, as
here. The ranking of G. Marckmann and E. Verron (*Rubber Chemistry and Technology* 79 (2006)
835-858) judges laws by all tests together. R. W. Ogden, G. Saccomandi and I. Sgura (*Computational
Mechanics* 34 (2004) 484-502) found that least squares often have several solutions for these data.
S. Connolly, D. Mackenzie and Y. Gorash (*The implications of constitutive model selection in
hyperelastic parameter identification*) conclude for ten laws, as this page does, that an accurate
fit of few tests may not predict others.
"""

# sphinx_gallery_thumbnail_number = 1

import warnings
from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr
from scipy import optimize, stats

import pymc_hyperelastic as ph

DRAWS, CHAINS = 300, 2  # draws in a chain, and number of chains
OUT = Path("results/rubber")  # folder of the results
OUT.mkdir(parents=True, exist_ok=True)
rng = np.random.default_rng(1)
FITTED = "uniaxial"

# %%
# The data
# --------
# Nominal stresses of one rubber in three tests. The sheet is free along y in the uniaxial test.
data = ph.load_dataset("treloar_rubber")
tests = {name: ph.select(data, experiment=name) for name in data["experiment"].values}

# %%
# The laws and their priors
# -------------------------
# The default priors are made for soft tissue, with moduli up to 200 kPa. The shear modulus of a
# vulcanised rubber is a few hundred kPa. Its prior here is half-normal with a scale of 1000 kPa.
# ``c1`` and ``c10`` are half a modulus. The second modulus of the Mooney-Rivlin law is a tenth of
# the first in rubber. The limit of Gent's law is 30 to 100 in rubber, and the stretch of an
# extended chain is 2 to 5; its prior goes up to 8. The scales of ``c2`` and ``c3`` make the three
# terms of Yeoh's law equal at a stretch of 7, where I₁ − 3 is 46; ``c2`` may be negative. The first
# exponents of Ogden and Lopez-Pamies are near that of the neo-Hookean law, 2 and 1. The second
# terms stiffen the rubber. Their exponents are 5 and 4, rounded from published fits to all three of
# these tests, so that these two priors are not independent of the data. Their moduli are known
# within a factor of 20 only, because they are multiplied by a high power of the stretch.
MODULUS = 1000.0  # kPa
GENT = ph.Gent()
PRIORS = {
    ph.NeoHookean(): {"mu": pm.HalfNormal.dist(MODULUS)},
    ph.MooneyRivlin(): {
        "c10": pm.HalfNormal.dist(MODULUS / 2),
        "c01": pm.HalfNormal.dist(MODULUS / 20),
    },
    ph.Yeoh(): {
        "c1": pm.HalfNormal.dist(MODULUS / 2),
        "c2": pm.Normal.dist(0, MODULUS / 2 / 46),
        "c3": pm.HalfNormal.dist(MODULUS / 2 / 46**2),
    },
    GENT: {"mu": pm.HalfNormal.dist(MODULUS), "limit": pm.Uniform.dist(30, 100)},
    ph.ArrudaBoyce(): {"mu": pm.HalfNormal.dist(MODULUS), "lock": pm.Uniform.dist(2, 8)},
    ph.OgdenSeries(2): {
        "mu": pm.LogNormal.dist(np.log([400, 1]), [1, 1.5]),
        "alpha": pm.LogNormal.dist(np.log([2, 5]), 0.25),
    },
    ph.LopezPamies(2): {
        "mu": pm.LogNormal.dist(np.log([400, 0.1]), [1, 1.5]),
        "alpha": pm.LogNormal.dist(np.log([1, 4]), 0.25),
    },
}
# The errors are mostly those of the laws. Their size is inferred; the scale of its prior is 3 % of
# the largest stress.
ERROR = pm.HalfNormal.dist(200)  # kPa


# %%
# Two ways to predict a test
# --------------------------
# Both are fitted to the uniaxial test alone. The first is the posterior: the median of the stress,
# and the interval that contains 95 % of the measurements, which have the inferred error.
def by_posterior(tree: xr.DataTree, test: xr.Dataset) -> np.ndarray:
    """Return the lower end, the upper end and the median of predicted measurements (kPa)."""
    with warnings.catch_warnings():
        # The equibiaxial test and pure shear are outside of the fitted stretches on purpose.
        warnings.filterwarnings("ignore", message=".*outside")
        found = ph.predict_stress(tree, test["stretch_x"], test["stretch_y"], nominal=True)
    stress, sd = found["stress_x"], tree["posterior"]["stress_sd"]
    measured = stress + sd * stress.copy(data=rng.standard_normal(stress.shape))
    ends = measured.quantile([0.025, 0.975], ("chain", "draw"))
    return np.array([*ends.values, stress.median(("chain", "draw")).values])


# %%
# The second is the usual fit by least squares, without priors. It starts from the mean of the
# posterior, and its intervals are those of a regression: the law is linearised at the best values.
def stresses(law: ph.StrainEnergy, entries: np.ndarray, test: xr.Dataset) -> np.ndarray:
    """Return the stresses (kPa) of materials, one in each row of `entries`."""
    ends = np.cumsum([parameter.size or 1 for parameter in law.parameters])
    posterior = {
        p.name: (("chain", "draw", f"{p.name}_entry"), own)
        if p.size
        else (("chain", "draw"), own[..., 0])
        for p, own in zip(law.parameters, np.split(entries[None], ends[:-1], axis=2), strict=True)
    }
    tree = xr.DataTree.from_dict({"posterior": xr.Dataset(posterior)})
    x, y = test["stretch_x"], test["stretch_y"]
    return ph.predict_stress(tree, x, y, nominal=True, energy=law)["stress_x"].values[0]


def by_least_squares(law: ph.StrainEnergy, tree: xr.DataTree) -> Callable:
    """Fit the uniaxial test; return a function with the result of `by_posterior`."""
    means = tree["posterior"].to_dataset().mean(("chain", "draw"))
    start = np.concatenate([np.ravel(means[p.name]) for p in law.parameters])
    measured = tests[FITTED]["stress_x"].values
    fit = optimize.least_squares(
        lambda entries: stresses(law, entries[None], tests[FITTED])[0] - measured,
        start,
        x_scale="jac",
        max_nfev=10_000,
    )
    freedom = measured.size - start.size
    variance = 2 * fit.cost / freedom
    covariance = variance * np.linalg.pinv(fit.jac.T @ fit.jac)

    def predict(test: xr.Dataset) -> np.ndarray:
        steps = 1e-5 * fit.x
        best, *others = stresses(law, fit.x + np.vstack([0 * steps, np.diag(steps)]), test)
        slopes = (others - best) / steps[:, None]
        spread = np.einsum("io,ij,jo->o", slopes, covariance, slopes)
        half = stats.t.ppf(0.975, freedom) * np.sqrt(variance + spread)
        return np.array([best - half, best + half, best])

    return predict


# %%
# Fit the uniaxial test, and predict the others
# ---------------------------------------------
# Errors are root mean squares, relative to the largest stress of the test, and widths are mean
# widths of the 95 % intervals. Columns with a prime are those of least squares.
fitted, rows, predicted = {}, {name: [] for name in tests}, {}
for law, priors in PRIORS.items():
    likelihood = ph.Gaussian(stress_sd=ERROR)
    model = ph.material_model(law, tests[FITTED], likelihood, priors=priors)
    tree = ph.sample_smc(model, DRAWS, CHAINS, random_seed=1, progressbar=False)
    fitted[law.name] = tree
    least_squares = by_least_squares(law, tree)
    for name, test in tests.items():
        measured, row = test["stress_x"].values, {"law": law.name}
        ways = {"posterior": by_posterior(tree, test), "least squares": least_squares(test)}
        for (way, (low, high, best)), mark in zip(ways.items(), ("", "'"), strict=True):
            error = np.sqrt(np.mean((best - measured) ** 2)) / measured.max()
            inside = (low <= measured) & (measured <= high)
            row[f"{way}: error, %"] = 100 * error
            row["in 95 %" + mark] = f"{inside.sum()} of {inside.size}"
            row["width, %" + mark] = 100 * np.mean(high - low) / measured.max()
        rows[name].append(row)
        predicted[law.name, name] = ways["posterior"]

table = pd.DataFrame(
    {
        "law": list(fitted),
        "log evidence": [str(ph.log_evidence(tree)) for tree in fitted.values()],
        "verdict": [ph.diagnose_evidence(tree).attrs["verdict"] for tree in fitted.values()],
        "error, kPa": [float(t["posterior"]["stress_sd"].mean()) for t in fitted.values()],
    }
)
print("Fitted to the uniaxial test")
print(table.to_string(index=False, float_format="{:.0f}".format))
for name, found in rows.items():
    print(f"\n{name}: {'fitted' if name == FITTED else 'predicted'}")
    print(pd.DataFrame(found).to_string(index=False, float_format="{:.1f}".format))

# %%
# What the residuals show
# -----------------------
# An inferred error is as large as the misfit of the law, so that the residuals agree with it. With
# a stated error of 30 kPa, half a per cent of the largest stress, the residuals of the best law are
# too large.
likelihood = ph.Gaussian(stress_sd=30.0)
model = ph.material_model(GENT, tests[FITTED], likelihood, priors=PRIORS[GENT])
with warnings.catch_warnings():
    warnings.filterwarnings("ignore", message="the fit is doubtful")  # printed below
    tree = ph.sample_smc(model, DRAWS, CHAINS, random_seed=1, progressbar=False)
print(ph.diagnose_evidence(tree).attrs["words"])

# %%
# The figure
# ----------
# Lines are medians. The band of Gent's law, which has the highest evidence, should contain 95 % of
# the measurements.
colours = {law: f"C{number}" for number, law in enumerate(fitted)}
figure, axes = plt.subplots(2, 2, figsize=(7, 6.5), layout="constrained")
for ax, (name, test) in zip(axes.flat, tests.items(), strict=False):
    for law in fitted:
        low, high, middle = predicted[law, name] / 1e3
        ax.plot(test["stretch_x"], middle, color=colours[law], label=law)
        if law == "Gent":
            ax.fill_between(test["stretch_x"], low, high, color=colours[law], alpha=0.25, lw=0)
    ax.plot(test["stretch_x"], test["stress_x"] / 1e3, "ko", ms=4, label="measured")
    ax.set(title=f"{name}, {'fitted' if name == FITTED else 'predicted'}")
    ax.set(xlabel="stretch", ylabel="nominal stress (MPa)")
    ax.set_ylim(
        -0.1 * float(test["stress_x"].max()) / 1e3, 1.3 * float(test["stress_x"].max()) / 1e3
    )
handles, labels = axes[0, 0].get_legend_handles_labels()
axes[1, 1].axis("off")
axes[1, 1].legend(handles, labels, loc="center")
figure.savefig(OUT / "predictions.png", dpi=150)
print(f"\nThe figure is in {OUT}/")
