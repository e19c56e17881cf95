"""
A cohort with known classes: are class probabilities right?
===========================================================

All data on this page are **simulated**. The specimens of two classes are drawn from known
distributions, so that the true class probabilities of each new specimen can be computed. They are
compared with the probabilities of two schemes that fit the classes to training specimens: classes
with variability, which infer the distributions, and the paper's pooled scheme, in which all
specimens of a class share one set of parameters.

**Limits.** The fitted classes use the true law and the true size of the errors, and their specimens
are normal on a scale on which the true ones are nearly normal. Only the two distributions are
inferred. The numbers show the behaviour of the schemes without other errors. They do not apply to
real tubes, whose law is unknown.

The classes overlap, so even the true model cannot classify every specimen. The best attainable
score is that of the true model, not 0.
"""

# sphinx_gallery_thumbnail_path = "stored/simulated_cohort/curves.png"

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import xarray as xr
from scipy.special import logsumexp, softmax
from scipy.stats import multivariate_normal

import pymc_hyperelastic as ph

TRAIN, NEW, OTHER = 40, 500, 200  # training specimens per class, new ones, ones of neither class
SEED = 1  # seed of the cohort
OUT = Path("results/simulated_cohort")  # folder of the results
OUT.mkdir(parents=True, exist_ok=True)
rng = np.random.default_rng(SEED)

# %%
# The classes
# -----------
# The tubes follow Ogden's law. In each class ln μ and ln α are normal, with standard deviations of
# 0.15 and 0.1, and negatively correlated. Each specimen is inflated twice, to the same radii, with
# errors of 0.1 kPa. A new specimen belongs to each class with a probability of 0.5.
RADII = np.linspace(7.1, 8.8, 15)  # mm
TUBE = ph.Tube(inner_radius=7.0, outer_radius=9.0)  # mm
EXPERIMENTS, ERROR = 2, 0.1  # kPa
MEDIANS = {"A": {"mu": 30.0, "alpha": 7.0}, "B": {"mu": 37.0, "alpha": 7.5}}  # μ in kPa
SPREAD, CORRELATION = np.array([0.15, 0.1]), np.array([[1, -0.4], [-0.4, 1]])
DISTRIBUTIONS = {
    name: multivariate_normal(np.log(list(median.values())), np.outer(SPREAD, SPREAD) * CORRELATION)
    for name, median in MEDIANS.items()
}


def curves(energy: ph.StrainEnergy, **parameters: np.ndarray) -> np.ndarray:
    """Return pressures (kPa) at the radii, with one row for each specimen."""
    columns = {name: value[:, None] for name, value in parameters.items()}
    return ph.inflation_pressure(energy, RADII, TUBE, **columns).eval()


def curves_of_class(name: str, count: int) -> np.ndarray:
    """Return curves of random specimens of a class."""
    mu, alpha = np.exp(DISTRIBUTIONS[name].rvs((count, 1), rng)).reshape(count, 2).T
    return curves(ph.Ogden(), mu=mu, alpha=alpha)


def measure(pressure: np.ndarray, groups: list[str], prefix: str) -> xr.Dataset:
    """Return the inflation data of specimens with these curves and errors."""
    shape = len(groups), EXPERIMENTS, RADII.size
    specimen, experiment, point = np.indices(shape).reshape(3, -1)
    measured = pressure[:, None] + ERROR * rng.standard_normal(shape)
    frame = pd.DataFrame(
        {
            "specimen": [f"{prefix}{i}" for i in specimen],
            "group": np.array(groups)[specimen],
            "experiment": experiment + 1,
            "radius": RADII[point],
            "pressure": measured.ravel(),
        }
    )
    return ph.inflation_data(frame, TUBE).assign_attrs(title="SIMULATED cohort", simulated=1)


training = {
    name: measure(curves_of_class(name, TRAIN), [name] * TRAIN, f"{name}-")
    for name in DISTRIBUTIONS
}
of_a = rng.binomial(NEW, 0.5)
truth = ["A"] * of_a + ["B"] * (NEW - of_a)
new = measure(
    np.concatenate([curves_of_class("A", of_a), curves_of_class("B", NEW - of_a)]),
    truth,
    "new-",
)

# %%
# The true model
# --------------
# The evidence of a specimen under a known class is an integral over μ and α, computed here without
# the package's classification. The pressure is μ times a function of α. Given α, the likelihood is
# therefore normal in μ, and far narrower than the class: three Gauss-Hermite nodes are enough. The
# grid of α is finer than the likelihood of any specimen. Factors that are the same for all classes
# are left out.
log_alpha = np.linspace(np.log(3.5), np.log(15), 1500)
unit = curves(ph.Ogden(), mu=np.ones_like(log_alpha), alpha=np.exp(log_alpha)) / ERROR
pressure = new["pressure"].values.reshape(NEW, EXPERIMENTS, RADII.size) / ERROR
precision = EXPERIMENTS * (unit**2).sum(axis=1)
best = pressure.sum(axis=1) @ unit.T / precision  # μ of the greatest likelihood: (specimen, α)
misfit = (pressure**2).sum(axis=(1, 2))[:, None] - best**2 * precision + np.log(precision)
nodes, weights = np.polynomial.hermite_e.hermegauss(3)
log_mu = np.log(best[..., None] + nodes / np.sqrt(precision)[:, None])
place = np.stack(np.broadcast_arrays(log_mu, log_alpha[:, None]), axis=-1)
log_evidence = [
    logsumexp(law.logpdf(place) - log_mu - misfit[..., None] / 2, axis=(1, 2), b=weights)
    for law in DISTRIBUTIONS.values()
]
known = xr.Dataset(
    {
        "log_evidence": (("specimen", "class_label"), np.transpose(log_evidence)),
        "class_probability": (("specimen", "class_label"), softmax(log_evidence, axis=0).T),
    },
    {"specimen": list(dict.fromkeys(new["specimen"].values)), "class_label": list(DISTRIBUTIONS)},
)

# %%
# Learn the classes, and classify
# -------------------------------
# Both schemes use the same training specimens and the same standard deviation of the errors.
fitted, results = {}, {"true": known}
for scheme, variability in {"variability": "specimen", "pooled": None}.items():
    print(f"{scheme}: fitting {len(training)} classes, classifying {NEW} specimens")
    fitted[scheme] = ph.fit_classes(
        ph.Ogden(),
        training,
        ph.Gaussian(pressure_sd=ERROR),
        variability=variability,
        draws=1000,
        chains=2,
        random_seed=SEED,
    )
    fitted[scheme].to_netcdf(OUT / f"{scheme}_classes.nc")
    results[scheme] = ph.classify(
        new,
        fitted[scheme],
        by="specimen",
        none_below=0.05 if scheme == "variability" else 0,
        random_seed=SEED,
    )
    results[scheme].to_netcdf(OUT / f"{scheme}_new.nc")
known.assign_attrs(title="SIMULATED cohort", simulated=1).to_netcdf(OUT / "true_new.nc")

# %%
# The scores
# ----------
# The log score is ln P(true class); a coin toss has ln ½ = −0.69. It is computed from the log
# evidences, because many probabilities of the pooled scheme are too small for floating-point
# numbers. The difference to the true model is computed for the same specimens. Its standard error
# applies to these training specimens; other training specimens give other classes. The best Brier
# score is 0, and a coin toss has 0.5. The calibration error is the difference between the
# probability of the most probable class and the fraction of specimens for which this class is
# right. By chance it is not exactly 0.
scores, log_scores = {}, {}
for scheme, result in results.items():
    scores[scheme] = ph.score_probabilities(result["class_probability"], truth)
    evidence = result["log_evidence"].to_pandas()
    of_truth = evidence.to_numpy()[np.arange(NEW), evidence.columns.get_indexer(truth)]
    log_scores[scheme] = of_truth - logsumexp(evidence.to_numpy(), axis=1)
rows = {}
for scheme, score in scores.items():
    less = log_scores[scheme] - log_scores["true"]
    rows[scheme] = {
        "log score": log_scores[scheme].mean(),
        "less the true": less.mean(),
        "standard error": less.std(ddof=1) / np.sqrt(less.size),
        "Brier score": score["mean_brier_score"].item(),
        "accuracy": score["accuracy"].item(),
        "calibration error": score["expected_calibration_error"].values[0],
    }
table = pd.DataFrame(rows).T
table.to_csv(OUT / "scores.csv")
pd.options.display.width = 200
print(f"\nSIMULATED: {NEW} new specimens, {TRAIN} of each class to learn from")
print(table.round(3).to_string())

# %%
# None of these
# -------------
# The specimens of neither class are of four kinds. Within a kind, their parameters differ by 7 %. A
# class with variability gives a p-value for each new specimen. If the p-values of both classes are
# below 0.05, the decision is "none of these". For a member of a class this decision is a false
# alarm. There should be fewer than 5 % false alarms, because the p-value of the other class must be
# small too.
KINDS = {
    "softer": (ph.Ogden(), {"mu": 15.0, "alpha": 7.0}),
    "stiffens sooner": (ph.Ogden(), {"mu": 30.0, "alpha": 12.0}),
    "soft, then stiff": (ph.Ogden(), {"mu": 18.0, "alpha": 11.0}),
    "does not stiffen": (ph.NeoHookean(), {"mu": 80.0}),
}
kinds, pressures = [], []
for kind, count in zip(KINDS, np.diff(np.linspace(0, OTHER, 5).astype(int)), strict=True):
    energy, medians = KINDS[kind]
    differ = {name: m * np.exp(0.07 * rng.standard_normal(count)) for name, m in medians.items()}
    pressures.append(curves(energy, **differ))
    kinds += [kind] * int(count)
others = measure(np.concatenate(pressures), kinds, "other-")
print(f"\nvariability: classifying {OTHER} specimens of neither class")
result = ph.classify(
    others,
    fitted["variability"],
    by="specimen",
    none_below=0.05,
    random_seed=SEED,
)
result.to_netcdf(OUT / "variability_other.nc")
decisions = pd.concat(
    [
        pd.DataFrame({"kind": labels, "flagged": decided == "none of these"})
        for labels, decided in (
            (truth, results["variability"]["decision"].values),
            (["neither class"] * len(kinds), result["decision"].values),
            (kinds, result["decision"].values),
        )
    ]
)
flagged = decisions.groupby("kind", sort=False)["flagged"].agg(["size", "sum", "mean"])
flagged.columns = ["specimens", "none of these", "share"]
flagged.to_csv(OUT / "none_of_these.csv")
print(flagged.round(3).to_string())

# %%
# The figures
# -----------
# The figure shows some curves of each class and of the other kinds.
figure, axes = plt.subplots(1, 3, figsize=(11, 4), sharey=True, layout="constrained")
samples = [(f"class {name}", training[name], {name: "C0"}) for name in training]
samples.append(("neither class", others, dict(zip(KINDS, ("C1", "C2", "C3", "C4"), strict=True))))
for ax, (title, data, colours) in zip(axes, samples, strict=True):
    for group, colour in colours.items():
        of_group = np.flatnonzero(data["group"] == group)
        for test in of_group[:: EXPERIMENTS * max(1, len(of_group) // 20)]:
            points = data["test"] == test
            ax.plot(data["radius"][points], data["pressure"][points], color=colour, linewidth=0.8)
        ax.plot([], [], color=colour, label=group)
    ax.set(title=title, xlabel="internal radius (mm)")
axes[0].set_ylabel("pressure (kPa)")
axes[2].legend(fontsize="small")
figure.suptitle("SIMULATED cohort")
figure.savefig(OUT / "curves.png", dpi=120)

# %%
# The next figure shows the calibration of the probabilities of the most probable class.
kept = ["count", "predicted_probability", "observed_frequency", "frequency_lower"]
kept += ["frequency_upper", "expected_calibration_error"]
reliability = xr.concat(
    [
        score[kept].sel(forecast=["most probable class"]).assign_coords(forecast=[scheme])
        for scheme, score in scores.items()
    ],
    "forecast",
).assign_attrs(simulated=1)
ph.plot_reliability(reliability).savefig(OUT / "reliability.png", dpi=120)

# %%
# The last figure shows the probability of class A by each scheme against the true probability, for
# all new specimens. Points of classes with variability deviate from the line if one class was
# inferred to be wider than the other: specimens that are far from both classes are then assigned to
# the wider class. The pooled scheme gives 0 or 1 for all specimens except one.
figure, axes = plt.subplots(1, 2, figsize=(8, 4), sharey=True, layout="constrained")
for ax, scheme in zip(axes, fitted, strict=True):
    ax.plot([0, 1], [0, 1], color="grey", linewidth=0.8)
    chances = [results[of]["class_probability"].sel(class_label="A") for of in ("true", scheme)]
    ax.plot(*chances, "o", markersize=3, alpha=0.5)
    ax.set(title=scheme, xlabel="true probability of class A")
axes[0].set_ylabel("probability of class A")
figure.suptitle("SIMULATED cohort")
figure.savefig(OUT / "class_probability.png", dpi=120)
print(f"\nTables, figures and netCDF files are in {OUT}/")
