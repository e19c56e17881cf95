"""Results as the package stores them, made by hand, without sampling."""

import json

import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.settings import ModelSettings

SEED = 20261126  # any would do: draws below stand for a posterior
DATA = ph.load_dataset("simulated_sheep_aorta")


def curves(names, group="C1"):
    """Return inflation data of these specimens on a straight line."""
    radius = np.linspace(7.2, 9.0, 6)
    points = {"experiment": 1, "group": group, "radius": radius, "pressure": 6 * (radius - 7.0)}
    frame = pd.concat([pd.DataFrame({"specimen": name} | points) for name in names])
    return ph.inflation_data(frame.reset_index(drop=True), ph.Tube(7.0, 9.0), check="ignore")


# About what the aortas have.
VALUES = {"mu": 70.0, "b": 0.5}


LIKELIHOOD = ph.SlopeAugmented(sigma=2.0, slope_weight=0.0)


def fitted_class(
    data, energy="Demiray", draws=100, chains=2, shift=0.0, likelihood=LIKELIHOOD, **attrs
):
    """Return a fitted class with a normal posterior about `VALUES`, without sampling."""
    rng = np.random.default_rng(SEED)
    posterior, priors, law = {}, {}, ph.StrainEnergy.from_name(energy)
    for p in law.parameters:
        low, high = p.prior_range
        values = 1 + 0.02 * rng.normal(size=(chains, draws))
        values *= VALUES.get(p.name, (low + high) / 4)
        posterior[p.name] = ("chain", "draw"), values + shift * np.arange(chains)[:, None]
        priors[p.name] = pm.Uniform.dist(low, high)
    evidence = {"log_evidence": np.linspace(-27.8, -27.7, chains)}
    evidence["log_evidence_se"] = np.full(chains, 0.05)
    check = {
        "value": [0.1, 0.9],
        "limit": [0.3, 2e-3],
        "verdict": ["good"] * 2,
        "words": [""] * 2,
    }
    good = {"verdict": "good", "words": "nothing is against it"}
    tree = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset(posterior, {"chain": range(chains), "draw": range(draws)}),
            "observed_data": data[["pressure"]].reset_coords(drop=True),
            "constant_data": data.drop_vars("pressure"),
            "evidence": xr.Dataset({name: ("chain", v) for name, v in evidence.items()}),
            "diagnosis": xr.Dataset(
                {name: ("check", v) for name, v in check.items()},
                {"check": ["chains", "residuals"]},
                good,
            ),
        }
    )
    tree.attrs = {
        **ModelSettings.of(law, priors, likelihood).attrs(),
        "versions": json.dumps({"pymc-hyperelastic": "0.0.9", "pymc": "6.1.0"}),
    } | attrs
    return tree


def fitted_classes(training=None, **settings):
    """Return two fitted classes of the simulated aortas, or of other data."""
    training = training or {
        name: ph.select(DATA, group=name, experiment=[1, 2]) for name in ("C1", "C2")
    }
    trees = {name: fitted_class(data, **settings) for name, data in training.items()}
    tree = xr.DataTree.from_dict(trees)
    tree.attrs = {"random_seed": "7"}
    return tree


def classified(names=("S1", "S2"), probability=((0.9, 0.1), (0.25, 0.75)), **variables):
    """Return a result of classify by specimen, with small errors."""
    table = np.array(probability, float)
    labels = ["C1", "C2", "C3"][: table.shape[1]]
    both = ("specimen", "class_label")
    tables = {
        "class_probability": table,
        "class_probability_se": np.full_like(table, 0.01),
        "log_evidence": np.log(np.maximum(table, 1e-300)) - 3.0,
        "log_evidence_se": np.full_like(table, 0.02),
        "pareto_k": np.full_like(table, -0.2),
        "method": np.full(table.shape, "class draws"),
        "decision": np.array(labels)[np.nan_to_num(table).argmax(axis=1)],
    } | variables
    return xr.Dataset(
        {k: (both[: np.ndim(v)], v) for k, v in tables.items()},
        {
            "specimen": list(names),
            "class_label": labels,
            "group": ("specimen", ["C1"] * len(names)),
        },
        {"class_prior": json.dumps(dict.fromkeys(labels, 1 / len(labels)))}
        | {"undecided_below": 0.0, "none_below": 0.0, "strain_energy": "Demiray"},
    )
