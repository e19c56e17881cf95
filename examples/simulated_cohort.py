"""
A cohort whose classes are known: are probabilities of class right?
===================================================================

Everything on this page is **simulated**. Specimens of two classes are drawn from distributions that
are written down below, so that the true probability of class of each new one can be worked out.
Beside it stand the probabilities of two schemes that have to learn the classes from some specimens
of each: classes with variability, which learn the distributions, and the paper's pooled scheme, in
which all specimens of a class share one set of parameters.

**What this can and cannot show.** The fitted classes are told the true material and the true size
of the errors, and their specimens are taken to be normal on a scale on which they nearly are. Only
the two distributions are left to learn. The numbers say what the schemes do where nothing else is
wrong. Of real tubes, whose material nobody knows, they say nothing.

The classes overlap: not even who knows all about them can tell every specimen. The score to come
near is the true model's, not 0.
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

TRAIN, NEW, OTHER = 40, 500, 200  # specimens a class, new ones, and some of neither class
SEED = 1  # of the cohort
OUT = Path("results/simulated_cohort")  # where results go
OUT.mkdir(parents=True, exist_ok=True)
rng = np.random.default_rng(SEED)

# %%
# The classes
# -----------
# Tubes of an Ogden solid. In each class ln μ and ln α are normal, with standard deviations of 0.15
# and 0.1; stiffer tubes tend to have smaller exponents. Each specimen is inflated twice, to the
# same radii, with errors of 0.1 kPa. A new specimen is of either class by the toss of a coin.
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
    """Pressures (kPa) at the radii, one row a specimen."""
    columns = {name: value[:, None] for name, value in parameters.items()}
    return ph.inflation_pressure(energy, RADII, TUBE, **columns).eval()


def curves_of_class(name: str, count: int) -> np.ndarray:
    """Curves of specimens of a class."""
    mu, alpha = np.exp(DISTRIBUTIONS[name].rvs((count, 1), rng)).reshape(count, 2).T
    return curves(ph.Ogden(), mu=mu, alpha=alpha)


def measure(pressure: np.ndarray, groups: list[str], prefix: str) -> xr.Dataset:
    """Inflation data of specimens with these curves, errors added."""
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
# What can be known
# -----------------
# The evidence of a specimen under a known class is an integral over μ and α, taken here without the
# package's classification. Pressure is μ times a curve of α alone. Given α, the likelihood is
# therefore normal in μ, and far narrower than the class: three points of Gauss and Hermite do. The
# grid of α is finer than the likelihood of any specimen. Factors that all classes share are left
# out.
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
# Both schemes see the same specimens and know the same errors, by their standard deviation.
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
# The log score is ln P(true class): ln ½ = −0.69 is that of a coin. It is taken from the evidences,
# for many a probability of the pooled scheme is too small a number for a computer. The difference
# to the true model's is that between the same specimens, and its standard error is for these
# training specimens: others give other classes.
# The Brier score is best at 0, and that of a coin is 0.5. The calibration error is how far the
# probability of the most probable class is from the share of specimens for which it was the right
# one; by chance alone it is not 0.
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
# Specimens of four other kinds, whose parameters differ by 7 % within a kind. A class with
# variability says how unlike its own specimens a new one is; where that is below 0.05 for both
# classes, the decision is "none of these". Members that are turned away are false alarms. There
# should be fewer than 5 % of them: a member must look strange to the other class as well.
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
# A few curves of each class, and of the other kinds.
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
# How reliable the probabilities of the most probable class are.
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
# Every new specimen: the probability of class A that each scheme gives over the true one. Where the
# points of classes with variability bend away from the line, one class was learned as wider than
# the other, and what is far from both is given to the wider one. The pooled scheme says 0 or 1 of
# all but one.
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
