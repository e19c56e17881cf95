"""Wrong input of models: the error names the place and the value, and says how to correct it."""

import numpy as np
import pandas as pd
import pymc as pm
import pytest
import shared_errors
import xarray as xr
from bad_input import (
    OGDEN,
    PLACE,
    SLOPES,
    assert_refused,
    curves,
    fit,
    model,
    potential,
    with_nan,
)

import pymc_hyperelastic as ph

SERIES = ph.OgdenSeries(terms=2)
NEO_HOOKEAN = ph.Layer(ph.NeoHookean(), 1.0)
RADIUS, HALF = pm.Uniform.dist(6, 7), pm.HalfNormal.dist()
TWICE, THICK = (RADIUS, HALF) * 2, curves(outer_radius=None)
SLOPED, PLAIN = ph.SlopeAugmented, ph.Gaussian
SIGNED = pm.Normal.dist(0.5, 0.3)
EXTENDED = shared_errors.EXTENDED


def prior(value, name="mu", **settings):
    return model(priors={name: value}, **settings)


def unknown(data=None, **priors):
    return model(data, priors=priors)


def layers(*walls, data=None, **settings):
    """A model of layers, by default of two that are neo-Hookean."""
    data = curves(outer_radius=None) if data is None else data
    return model(data, energy=list(walls or (NEO_HOOKEAN, NEO_HOOKEAN)), **settings)


def extension(likelihood=1.0, **settings):
    """A model of two tests in which the axial stretch varies."""
    data = ph.select(shared_errors.extended(), experiment=list(EXTENDED))
    return model(data, likelihood=likelihood, **settings)


def population(energy=OGDEN, data=None, likelihood=0.8, **settings):
    data = curves() if data is None else data
    return ph.population_model(energy, data, likelihood, **settings)


def inside(make):
    """A call in the context of a model that has a variable 'mu' and a dimension 'test'."""
    with pm.Model(coords={"test": ["mine"]}):
        return make(pm.Uniform("mu", 0, 50))


class EitherSign(ph.MooneyRivlin):
    """A law with a modulus that may be negative."""

    parameters = ph.MooneyRivlin.parameters[0], ph.Parameter("c01", "", "kPa", (-9.0, 9.0), "")


class Membrane(ph.NeoHookean):
    """A law with a parameter that has the name of a measure of the tube."""

    parameters = *ph.NeoHookean.parameters, ph.Parameter("thickness", "h", "mm", (0.1, 1.0), "")


VALUES = {"mu": 6.0, "alpha": 6.0}
GIVEN, FOREIGN = ph.Layer(ph.Demiray(), 0.2, b=HALF), inside(lambda mu: mu)
NO_OFFSETS = xr.DataTree.from_dict({"posterior": curves()})
# Calls and fragments of the message, by the error that they raise.
TYPE_ERRORS = [
    # Material, data, likelihood.
    (lambda: model(pd.DataFrame({"radius": [1.0]})), "inflation_data(|DataFrame"),
    (lambda: model(likelihood="paper"), "likelihood is 'paper'|ph.Gaussian(pressure_sd="),
    (lambda: SLOPED("5 mmHg", 1.0), "sigma is '5 mmHg'|5 * ph.mmHg|distribution"),
    (lambda: SLOPED(sigma=None, slope_weight=0.0), "sigma is None|√2"),
    (lambda: PLAIN(), "pressure_sd is None|kPa"),
    (lambda: PLAIN(pm.HalfNormal.dist(shape=3)), "pressure_sd|1 dimension|scalar"),
    (lambda: PLAIN(1.0, observed="yes"), "observed is 'yes'|True or False"),
    # Priors.
    (lambda: prior(6.0), "'mu' is 6.0|pm.Uniform.dist(0, 50)"),
    (lambda: prior(pm.Normal.dist(pm.HalfNormal.dist(), 1)), "'mu'|halfnormal"),
    (lambda: model(priors=[pm.Uniform.dist(0, 50)]), 'priors|dict|{"mu": pm.Uniform.dist(0, 50)}'),
    (lambda: prior(pm.Uniform.dist(0, 50), energy=SERIES), "'mu'|shape ()|2 entries|shape=2"),
    # Parameters of the likelihood.
    (lambda: ph.inflation_likelihood("x", OGDEN, curves(), SLOPES, {}), "with pm.Model():"),
    (lambda: potential({"mu": 6.0}), "Ogden|['mu', 'alpha']|['mu'] were given"),
    (lambda: potential({"mu": np.ones(2), "alpha": 6.0}), "'mu'|1 dimension|scalar"),
    (lambda: potential(energy=[NEO_HOOKEAN]), "ph.Ogden()|Layer(NeoHookean()"),
    # Geometry.
    (lambda: population(priors={"inner_radius": RADIUS}), "where specimens differ, expected"),
    # Layers.
    (lambda: layers(priors={"mu": pm.Uniform.dist(0, 50)}), "layers take their own priors|'mu'"),
    (lambda: layers(ph.Layer(ph.NeoHookean(), 1.0, mu="stiff")), "mu_1 is 'stiff'|a number"),
    (lambda: layers(ph.Layer(SERIES, 1.0, mu=[3.0])), "mu_1 is [3.0]|2 numbers"),
    # Populations.
    (lambda: ph.Variability(experiment_effect=1), "experiment_effect is 1|True or False"),
    (lambda: population(variability=None), "variability is None|ph.Variability"),
    (lambda: population(priors={"location": HALF}), "'location' has the shape|shape=2"),
    (lambda: population([GIVEN], THICK), "layer 1 has a distribution for 'b'"),
    # Models in the context of another one.
    (lambda: inside(lambda _: prior(FOREIGN)), "'mu'|with model:"),
    (lambda: inside(lambda mu: prior(pm.LogNormal.dist(mu, 1))), "depends on the random variable"),
    (lambda: inside(lambda mu: fit(priors={"mu": mu})), "'mu'|independent"),
    (lambda: inside(lambda _: model(name=1)), "name is 1|'artery'"),
    (ph.sample_smc, "no model is given|in context"),
    (lambda: ph.force_offsets(curves()), "DataTree"),
]
VALUE_ERRORS = [
    # Data, likelihood, slopes.
    (lambda: model(with_nan()), f"{PLACE}|row 43|pressure is nan kPa"),
    (lambda: SLOPED(0, 1.0), "sigma is 0|positive|kPa"),
    (lambda: SLOPED(1.0, -0.5), "slope_weight is -0.5|mm²|0 to leave the slopes out"),
    (lambda: model(curves([7.2, 7.6], [2.0, 4.0])), f"{PLACE}|2 point(s)|at least 3"),
    (lambda: ph.balanced_slope_weight(curves(pressure=[5.0] * 4)), "all slopes|zero"),
    (lambda: model(mode="fast"), "mode is 'fast'|'collocation'|'quadrature'"),
    # Forces, radii with errors, slopes that are no part of a likelihood.
    (lambda: model(likelihood=SLOPED(1.0, 1.0, force_sigma=1.0)), "force_sigma|no axial forces"),
    (lambda: PLAIN(1.0, force_offset_sd=5.0), "force_offset_sd|force_sd|mN"),
    (lambda: SLOPED(1.0, 1.0, force_offset_sd=5.0), "force_offset_sd|force_sigma|√2"),
    (lambda: PLAIN(1.0, radius_sd=0.1), "radius_sd and pressure_sd|mm|kPa|diameter_sd"),
    (lambda: PLAIN(radius_sd=0.1, diameter_sd=0.1), "leave diameter_sd away"),
    (lambda: PLAIN(radius_sd=0.1, observed=True), "known radii"),
    (lambda: SLOPED(1.0, HALF, observed=True), "slope_weight is a distribution|must be a number"),
    (lambda: potential(likelihood=PLAIN(1.0, observed=True)), "observed=True|ph.inflation_model"),
    (lambda: fit(likelihood=PLAIN(1.0, observed=True)), "omit observed=True"),
    (lambda: fit(likelihood=PLAIN(radius_sd=0.1)), "error in the pressure"),
    (lambda: model(likelihood=SIGNED), "'pressure_sd' has draws such as -|positive numbers"),
    (lambda: fit(likelihood=SIGNED), "'pressure_sd' has draws such as -|positive numbers"),
    (lambda: inside(lambda mu: model(likelihood=mu - 1, name="x")), "'pressure_sd' has draws"),
    (lambda: ph.force_offsets(NO_OFFSETS), "no offsets of the force transducer"),
    # Priors.
    (lambda: prior(pm.Uniform.dist(0, 5), "n"), "'n'|Ogden|['mu', 'alpha']|'thickness'"),
    (lambda: potential(name="mu"), "mu|already"),
    (lambda: potential({"mu": np.nan, "alpha": 6.0}), "'mu' is nan|finite"),
    # Geometry.
    (lambda: model(curves(inner_radius=None)), f"{PLACE}|priors={{'inner_radius': ...}}"),
    (lambda: potential(VALUES | {"thickness": 2.0}), "holds 'thickness'|'outer_radius'"),
    (lambda: unknown(radius=RADIUS), "'radius'|'wall_area'|'opening_angle'"),
    (lambda: unknown(outer_radius=RADIUS, thickness=RADIUS), "['outer_radius', 'thickness']"),
    (lambda: model(priors={"inner_radius": RADIUS}, mode="collocation"), "mode='quadrature'"),
    (lambda: unknown(thickness=ph.MeasuredValue()), "the data hold no thickness_sd"),
    (
        lambda: fit(priors={"thickness": ph.MeasuredValue()}),
        "'thickness'|only with variability='specimen'",
    ),
    (lambda: model(energy=Membrane()), "Membrane|'thickness'|another name"),
    (lambda: population(Membrane()), "Membrane|'thickness'|another name"),
    (lambda: fit(energy=Membrane()), "Membrane|'thickness'|another name"),
    (lambda: potential({"mu": 6.0, "thickness": 2.0}, Membrane()), "Membrane|'thickness'"),
    # Layers.
    (lambda: layers(data=curves()), "layers state the thickness|ph.Tube(inner_radius=...)"),
    (
        lambda: layers(priors={"thickness": ph.MeasuredValue(0.1)}),
        "give a layer's thickness a prior",
    ),
    (lambda: layers(*(ph.Layer(ph.NeoHookean(), 1, mu=mu) for mu in TWICE)), "same name|'mu'"),
    (lambda: fit({"C1": THICK}, energy=[NEO_HOOKEAN]), "group 'C1'|layers|do not make a class"),
    # Extension tests.
    (lambda: extension(SLOPES), "experiment 0: axial_stretch varies|ph.Gaussian"),
    (lambda: extension(priors={"axial_stretch": RADIUS}), "stretch varies|leave it out"),
    # Populations.
    (lambda: population(EitherSign()), "'c01' of EitherSign|'real'|positive prior_range"),
    (
        lambda: population(likelihood=SIGNED),
        "'pressure_sd' has draws such as -",
    ),
    (lambda: ph.Variability(reference_stress=0.0), "reference_stress is 0.0; expected a positive"),
    (lambda: population(variability="test"), "variability is 'test'|ph.Variability"),
    (lambda: population(priors={"mu": HALF}), "prior is given for 'mu'|spread"),
    (
        lambda: population(likelihood=PLAIN(1, force_sd=1, force_offset_sd=HALF)),
        "force_offset_sd is a distribution",
    ),
    (lambda: population(likelihood=SLOPED(1, HALF)), "slope_weight is a distribution"),
    (lambda: population(likelihood=PLAIN(radius_sd=0.1)), "known radii"),
    # Models in the context of another one.
    (lambda: inside(prior), "['test']|name='artery'|by itself"),
    (lambda: inside(lambda mu: prior(mu, rising=True)), "rising=True|variables of your own model"),
    (lambda: ph.sample_smc(inside(lambda _: model(name="x"))), "'x' is a part|model.root"),
    (lambda: model(name="artery"), "'artery'|no model is in context"),
]
ROWS = [(TypeError, *row) for row in TYPE_ERRORS] + [(ValueError, *row) for row in VALUE_ERRORS]


@pytest.mark.parametrize(("error", "call", "fragments"), ROWS, ids=[row[2][:40] for row in ROWS])
def test_wrong_input_of_models_is_refused_with_place_and_remedy(error, call, fragments):
    assert_refused(call, error, fragments.split("|"))
