"""The kind of class that the arguments of fit_classes state, and its stored settings."""

from dataclasses import asdict

import pymc as pm
import pytest

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.classes.kinds import kind_of_settings
from pymc_hyperelastic.classes.pooled import PooledClass
from pymc_hyperelastic.models.settings import ModelSettings

OGDEN, NOISE = ph.Ogden(), ph.Gaussian(pressure_sd=1.0)


def settings_of(priors=None, variability=None):
    return kind_of_settings(OGDEN, NOISE, priors, variability).settings()


def test_variability_selects_pooled_or_hierarchical_classes():
    """None means one material of all specimens; "specimen" means the default `Variability()`."""
    assert isinstance(kind_of_settings(OGDEN, NOISE, None, None), PooledClass)
    assert isinstance(kind_of_settings(OGDEN, NOISE, None, "specimen"), HierarchicalClass)
    assert settings_of(variability="specimen") == settings_of(variability=ph.Variability())
    other = settings_of(variability=ph.Variability(experiment_effect=True))
    assert other != settings_of(variability="specimen")


def test_stored_settings_keep_their_names_and_restore_the_class():
    """Results in existing files use these names, and they have to open."""
    variability = ph.Variability(experiment_effect=True, reference_stress=30.0)
    priors = {
        "spread": pm.LogNormal.dist(-1.0, 0.5, shape=2),
        "thickness": ph.MeasuredValue(sd=0.1),
    }
    settings = settings_of(priors, variability)
    record = asdict(settings)
    assert record["variability"] == "specimen" and record["experiment_effect"] is True
    assert record["reference_stress"] == 30.0 and record["geometry_sd"] == {"thickness": 0.1}
    assert list(record["priors"]) == ["spread"]
    kind = HierarchicalClass.from_settings(settings)
    assert kind.variability == variability and list(kind.geometry) == ["thickness"]
    assert kind.settings() == settings
    assert asdict(settings_of())["variability"] == "none"
    assert PooledClass.from_settings(ModelSettings(**vars(settings_of()))).settings().priors


@pytest.mark.parametrize(
    "variability", ["specimen", ph.Variability(True)], ids=["specimen", "experiment effect"]
)
def test_population_model_has_the_stated_variability(variability):
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), group="C1", experiment=1)
    priors = {"thickness": ph.MeasuredValue(sd=0.1), "effect_spread": pm.Exponential.dist(2.0)}
    if variability == "specimen":
        del priors["effect_spread"]
    model = ph.population_model(
        ph.NeoHookean(), data, NOISE, priors=priors, variability=variability
    )
    assert ("effect_spread" in model.named_vars) == (variability != "specimen")
    assert model.named_vars_to_dims["thickness_deviation"] == ("specimen",)
