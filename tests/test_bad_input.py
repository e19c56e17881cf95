"""Whatever is wrong with the input, one error says where and what was expected, before sampling.

Tables of measurements and the data made of them have a table of their own, in `test_data.py`.
"""

from functools import cache

import numpy as np
import pandas as pd
import pymc as pm
import pytest
import xarray as xr

import pymc_hyperelastic as ph

OGDEN = ph.Ogden()
SERIES = ph.OgdenSeries(terms=2)
NEO_HOOKEAN = ph.Layer(ph.NeoHookean(), 1.0)
SHARED = pm.Uniform.dist(0, 50), pm.Uniform.dist(0, 50)
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
OGDEN_TUBE = {**TUBE, "mu": 6.0, "alpha": 8.0}
NOISE = {"sigma": 1.0, "slope_weight": 1.0}


def curves(radius=(7.2, 7.6, 8.0, 8.4), pressure=(2.0, 4.0, 7.0, 12.0)) -> xr.Dataset:
    """One test of specimen S2, experiment 3, whose rows are labelled from 41."""
    frame = pd.DataFrame({"specimen": "S2", "experiment": 3, "radius": radius})
    frame["pressure"] = pressure
    frame.index += 41
    return ph.inflation_data(frame, **TUBE)


def unknown_curves(forces=None, **geometry) -> xr.Dataset:
    """The same test of a tube of which something is not known, perhaps with forces."""
    frame = pd.DataFrame({"specimen": "S2", "experiment": 3, "radius": [7.2, 7.6, 8.0, 8.4]})
    frame["pressure"] = [2.0, 4.0, 7.0, 12.0]
    if forces is not None:
        frame["axial_force"] = forces
    return ph.inflation_data(frame, **TUBE | geometry)


def unknown(*names: str, **settings) -> pm.Model:
    """A model in which some of the tube is inferred."""
    priors = {name: pm.Uniform.dist(1, 2) for name in names}
    return model(**{"geometry": priors} | settings)


def layers(*walls, data=None, **settings) -> pm.Model:
    """A model of layers, all of them neo-Hookean but for those given."""
    walls = walls or (NEO_HOOKEAN, NEO_HOOKEAN)
    data = unknown_curves(outer_radius=None) if data is None else data
    return model(data, energy=list(walls), **settings)


def with_nan() -> xr.Dataset:
    data = curves()
    data["pressure"][2] = np.nan
    return data


def two_tubes() -> xr.Dataset:
    """Two specimens of different inner radius."""
    frame = pd.DataFrame({"specimen": ["S1"] * 3 + ["S2"] * 3, "experiment": 1})
    frame["radius"] = [7.2, 7.6, 8.0] * 2
    frame["pressure"] = [2.0, 4.0, 7.0] * 2
    frame["A"] = [7.0] * 3 + [6.5] * 3
    return ph.inflation_data(frame, inner_radius="A", outer_radius=9.0)


def model(data=None, energy=OGDEN, **settings) -> pm.Model:
    return ph.inflation_model(energy, curves() if data is None else data, **{**NOISE, **settings})


def likelihood(parameters=None, energy=OGDEN, name="curves", data=None, **settings) -> None:
    """The likelihood inside a model of one's own."""
    with pm.Model():
        mu = pm.Uniform("mu", 0, 50)
        parameters = {"mu": mu, "alpha": 6.0} if parameters is None else parameters
        data = curves() if data is None else data
        ph.inflation_likelihood(name, energy, data, parameters, **{**NOISE, **settings})


def registered() -> object:
    """A random variable that belongs to a model."""
    with pm.Model():
        return pm.Uniform("stiffness", 0, 50)


def plain_model() -> pm.Model:
    """The smallest model that can be sampled: it compiles in no time."""
    with pm.Model() as plain:
        x = pm.Normal("x")
        pm.Potential("likelihood", -(x**2))
    return plain


def smc(model=None, **settings) -> xr.DataTree:
    model = plain_model() if model is None else model
    return ph.sample_smc(model, **{"draws": 50, "chains": 1, "progressbar": False, **settings})


def model_of(kind: str) -> pm.Model:
    """A model that SMC cannot sample."""
    with pm.Model() as other:
        if kind == "discrete":
            count = pm.Poisson("count", 3)
            pm.Potential("likelihood", -count)
        elif kind == "no likelihood":
            pm.Normal("x")
        elif kind == "nothing free":
            pm.Normal("y", observed=1.0)
        elif kind == "impossible":
            x = pm.Uniform("x", 0, 1)
            pm.Potential("likelihood", pm.math.log(-x))
        elif kind == "flat":
            x = pm.Flat("x")
            pm.Potential("likelihood", -(x**2))
    return other


def fit(classes=None, energy=OGDEN, **settings) -> xr.DataTree:
    classes = {"C1": curves(), "C2": curves()} if classes is None else classes
    few = {"draws": 50, "chains": 1, "progressbar": False}
    return ph.fit_classes(energy, classes, **{**NOISE, **few, **settings})


@cache
def fitted() -> xr.DataTree:
    """Two fitted classes."""
    return fit({"C1": curves(), "C2": two_tubes()}, random_seed=1)


def altered(name: str, key: str, value: str) -> xr.DataTree:
    """Fitted classes of which one was fitted with other settings."""
    classes = fitted().copy()
    classes[name].attrs[key] = value
    return classes


def without(group: str) -> xr.DataTree:
    """A fitted class that lacks a group."""
    return fitted()["C1"].copy().filter(lambda node: node.name != group)


def classify(data=None, classes=None, **settings) -> xr.Dataset:
    data = curves() if data is None else data
    classes = fitted() if classes is None else classes
    return ph.classify(data, classes, progressbar=False, **settings)


def predict(tree=None, radius=(8.0, 9.0), **settings) -> xr.Dataset:
    return ph.predict_pressure(fitted()["C1"] if tree is None else tree, radius, **settings)


def disagreeing_energy() -> type:
    class Disagreeing(ph.StrainEnergy):
        parameters = (ph.Parameter("mu", r"\mu", "kPa", (0.0, 1.0), "modulus"),)

        def energy(self, radial, hoop, axial, *, modulus):
            return modulus * hoop

    return Disagreeing


PLACE = "specimen 'S2', experiment 3"

# Each row: what is wrong, a call that does it, the error, and fragments that its message must hold.
BAD_INPUT = [
    # Pressure of a tube, and the strain energies.
    (
        "missing material parameter",
        lambda: ph.inflation_pressure(OGDEN, 8.0, **TUBE, mu=6.0),
        TypeError,
        ["Ogden", "['mu', 'alpha']", "['mu'] were given"],
    ),
    (
        "unknown material parameter",
        lambda: ph.inflation_stiffness(OGDEN, 8.0, **TUBE, mu=6.0, n=2.0),
        TypeError,
        ["Ogden", "['mu', 'alpha']", "['mu', 'n'] were given"],
    ),
    (
        "class for strain energy",
        lambda: ph.inflation_pressure(ph.Ogden, 8.0, **OGDEN_TUBE),
        TypeError,
        ["ph.Ogden()", "call the class"],
    ),
    (
        "name for strain energy",
        lambda: ph.inflation_stiffness("Ogden", 8.0, **OGDEN_TUBE),
        TypeError,
        ["ph.Ogden()", "not 'Ogden'"],
    ),
    (
        "tube without wall",
        lambda: ph.inflation_pressure(OGDEN, 8.0, **{**OGDEN_TUBE, "outer_radius": 7.0}),
        ValueError,
        ["outer_radius must exceed inner_radius", "7.0"],
    ),
    (
        "one negative radius",
        lambda: ph.inflation_pressure(OGDEN, [8.0, -8.0], **OGDEN_TUBE),
        ValueError,
        ["internal_radius must be positive", "-8."],
    ),
    (
        "one radius missing",
        lambda: ph.inflation_pressure(OGDEN, [8.0, np.nan], **OGDEN_TUBE),
        ValueError,
        ["internal_radius must be positive", "nan"],
    ),
    (
        "no axial stretch",
        lambda: ph.inflation_stiffness(OGDEN, 8.0, **OGDEN_TUBE, axial_stretch=0.0),
        ValueError,
        ["axial_stretch must be positive", "0.0"],
    ),
    (
        "opening angle in degrees",
        lambda: ph.inflation_pressure(OGDEN, 8.0, **OGDEN_TUBE, opening_angle=60.0),
        ValueError,
        ["opening_angle is in radians", "60.0", "np.deg2rad"],
    ),
    (
        "text for radius",
        lambda: ph.inflation_pressure(OGDEN, "wide", **OGDEN_TUBE),
        TypeError,
        ["internal_radius", "wide"],
    ),
    (
        "unknown strain energy",
        lambda: ph.StrainEnergy.from_name("Fung"),
        ValueError,
        ["'Fung'", "'Ogden'", "import its class"],
    ),
    (
        "energy of other parameters",
        disagreeing_energy,
        TypeError,
        ["Disagreeing", "['mu']", "['modulus']"],
    ),
    # Models.
    (
        "class for a model's strain energy",
        lambda: model(energy=ph.Ogden),
        TypeError,
        ["ph.Ogden()", "call the class"],
    ),
    (
        "frame for a model's data",
        lambda: model(pd.DataFrame({"radius": [1.0]})),
        TypeError,
        ["inflation_data(", "DataFrame"],
    ),
    (
        "data altered",
        lambda: model(with_nan()),
        ValueError,
        [PLACE, "row 43", "pressure is nan kPa"],
    ),
    ("no error", lambda: model(sigma=0), ValueError, ["sigma is 0", "positive", "kPa"]),
    ("negative error", lambda: model(sigma=-1.0), ValueError, ["sigma is -1.0", "positive"]),
    ("nan error", lambda: model(sigma=np.nan), ValueError, ["sigma is nan", "positive", "kPa"]),
    ("infinite error", lambda: model(sigma=np.inf), ValueError, ["sigma is inf", "positive"]),
    (
        "error with a unit",
        lambda: model(sigma="5 mmHg"),
        TypeError,
        ["sigma is '5 mmHg'", "5 * ph.mmHg", "distribution"],
    ),
    ("truth for an error", lambda: model(sigma=True), TypeError, ["sigma is True", "kPa"]),
    ("no number for an error", lambda: model(sigma=None), TypeError, ["sigma is None", "kPa"]),
    (
        "an error a test",
        lambda: model(sigma=pm.HalfNormal.dist(shape=3)),
        TypeError,
        ["sigma", "1 dimension", "scalar"],
    ),
    (
        "negative slope weight",
        lambda: model(slope_weight=-0.5),
        ValueError,
        ["slope_weight is -0.5", "mm²", "0 to leave the slopes out"],
    ),
    (
        "nan slope weight",
        lambda: model(slope_weight=np.nan),
        ValueError,
        ["slope_weight is nan", "mm²"],
    ),
    (
        "text slope weight",
        lambda: model(slope_weight="balanced"),
        TypeError,
        ["slope_weight is 'balanced'", "mm²"],
    ),
    (
        "truth for a slope weight",
        lambda: model(slope_weight=True),
        TypeError,
        ["slope_weight is True", "mm²"],
    ),
    (
        "too few points for a slope",
        lambda: model(curves([7.2, 7.6], [2.0, 4.0])),
        ValueError,
        [PLACE, "2 point(s)", "at least 3", "slope_weight=0"],
    ),
    (
        "repeated radius",
        lambda: model(curves([7.2, 7.84, 8.0, 7.84])),
        ValueError,
        [PLACE, "rows 42 and 44", "7.84 mm", "drop one or set slope_weight=0"],
    ),
    (
        "repeated radius for an inferred slope weight",
        lambda: model(curves([7.2, 7.84, 8.0, 7.84]), slope_weight=pm.HalfNormal.dist()),
        ValueError,
        [PLACE, "rows 42 and 44", "7.84 mm"],
    ),
    (
        "prior of an unknown parameter",
        lambda: model(priors={"n": pm.Uniform.dist(0, 5)}),
        ValueError,
        ["'n'", "Ogden", "['mu', 'alpha']"],
    ),
    (
        "number for a prior",
        lambda: model(priors={"mu": 6.0}),
        TypeError,
        ["'mu' is 6.0", "pm.Uniform.dist(0, 50)"],
    ),
    (
        "range for a prior",
        lambda: model(priors={"mu": (0, 50)}),
        TypeError,
        ["'mu' is (0, 50)", "pm.Uniform.dist(0, 50)"],
    ),
    (
        "class for a prior",
        lambda: model(priors={"mu": pm.Uniform}),
        TypeError,
        ["'mu'", "pm.Uniform.dist(0, 50)"],
    ),
    (
        "vector prior",
        lambda: model(priors={"mu": pm.Uniform.dist(0, [20, 50])}),
        TypeError,
        ["'mu'", "shape (2,)", "scalar"],
    ),
    (
        "prior of another model",
        lambda: model(priors={"mu": registered()}),
        TypeError,
        ["'mu'", "'stiffness'", "pm.Uniform.dist(0, 50)", "ph.inflation_likelihood"],
    ),
    (
        "prior that depends on another model",
        lambda: model(priors={"mu": pm.Normal.dist(registered(), 1)}),
        TypeError,
        ["'mu'", "'stiffness'", "ph.inflation_likelihood"],
    ),
    (
        "prior stated by a distribution",
        lambda: model(priors={"mu": pm.Normal.dist(pm.HalfNormal.dist(), 1)}),
        TypeError,
        ["'mu'", "halfnormal", "ph.inflation_likelihood"],
    ),
    (
        "expression for a prior",
        lambda: model(priors={"mu": 2 * pm.Uniform.dist(0, 25)}),
        TypeError,
        ["'mu'", "pm.Uniform.dist(0, 50)"],
    ),
    (
        "list of priors",
        lambda: model(priors=[pm.Uniform.dist(0, 50)]),
        TypeError,
        ["priors", "dict", '{"mu": pm.Uniform.dist(0, 50)}'],
    ),
    (
        "unknown mode",
        lambda: model(mode="fast"),
        ValueError,
        ["mode is 'fast'", "'collocation'", "'quadrature'"],
    ),
    (
        "constant pressure has no balance",
        lambda: ph.balanced_slope_weight(curves(pressure=[5.0] * 4)),
        ValueError,
        ["all slopes", "zero"],
    ),
    (
        "balance of a frame",
        lambda: ph.balanced_slope_weight(pd.DataFrame()),
        TypeError,
        ["inflation_data(", "DataFrame"],
    ),
    # Forces, radii, and what is not known of the tube.
    (
        "error of forces that are not there",
        lambda: model(force_sigma=1.0),
        ValueError,
        ["force_sigma", "no axial forces", "'axial_force'"],
    ),
    (
        "error of forces none of which was measured",
        lambda: model(unknown_curves(forces=np.nan), force_sigma=1.0),
        ValueError,
        ["force_sigma", "no axial forces"],
    ),
    (
        "negative error of forces",
        lambda: model(unknown_curves(forces=1.0), force_sigma=-1.0),
        ValueError,
        ["force_sigma is -1.0", "positive", "mN"],
    ),
    (
        "text for an error of forces",
        lambda: model(unknown_curves(forces=1.0), force_sigma="1 mN"),
        TypeError,
        ["force_sigma is '1 mN'", "mN", "distribution"],
    ),
    (
        "error in something else",
        lambda: model(error_in="diameter"),
        ValueError,
        ["error_in is 'diameter'", "'pressure', 'radius'"],
    ),
    (
        "slopes with the error in the radius",
        lambda: model(error_in="radius"),
        ValueError,
        ["slope_weight is 1.0", "error_in='radius'", "expected 0"],
    ),
    (
        "inferred slope weight with the error in the radius",
        lambda: model(error_in="radius", slope_weight=pm.HalfNormal.dist()),
        ValueError,
        ["slope_weight", "error_in='radius'", "expected 0"],
    ),
    (
        "classes with the error in the radius",
        lambda: fit(error_in="radius"),
        TypeError,
        ["error_in"],
    ),
    (
        "unknown radius without a prior",
        lambda: model(unknown_curves(inner_radius=None)),
        ValueError,
        [PLACE, "inner_radius is not known", "geometry={'inner_radius': ...}"],
    ),
    (
        "unknown angle without a prior",
        lambda: unknown("axial_stretch", data=unknown_curves(opening_angle=None)),
        ValueError,
        [PLACE, "opening_angle is not known", "geometry={'opening_angle': ...}"],
    ),
    (
        "unknown radius of a likelihood",
        lambda: likelihood(data=unknown_curves(outer_radius=None)),
        ValueError,
        [PLACE, "outer_radius is not known"],
    ),
    (
        "prior of an unknown measure",
        lambda: unknown("radius"),
        ValueError,
        ["'radius'", "'wall_area'", "'opening_angle'"],
    ),
    (
        "two priors of the outer radius",
        lambda: unknown("inner_radius", "outer_radius", "thickness"),
        ValueError,
        ["['outer_radius', 'thickness']", "one of them"],
    ),
    (
        "thickness without inner radius",
        lambda: unknown("thickness"),
        ValueError,
        ["thickness is inferred together with inner_radius", "outer_radius"],
    ),
    (
        "wall area without inner radius",
        lambda: unknown("wall_area", "axial_stretch"),
        ValueError,
        ["wall_area is inferred together with inner_radius", "outer_radius"],
    ),
    (
        "unknown tube and constant matrices",
        lambda: unknown("inner_radius", mode="collocation"),
        ValueError,
        ["a geometry that is inferred", "mode='quadrature'"],
    ),
    (
        "number for a prior of a radius",
        lambda: model(geometry={"inner_radius": 7.0}),
        TypeError,
        ["'inner_radius' is 7.0", "pm.Uniform.dist(0, 50)"],
    ),
    (
        "a radius a test",
        lambda: model(geometry={"inner_radius": pm.Uniform.dist(6, 7, shape=2)}),
        TypeError,
        ["'inner_radius'", "shape (2,)", "scalar"],
    ),
    (
        "list of geometry",
        lambda: model(geometry=["inner_radius"]),
        TypeError,
        ["geometry must be a dict", "pm.Uniform.dist(0.3, 0.5)", "list"],
    ),
    (
        "likelihood of an unknown measure",
        lambda: likelihood(geometry={"thickness": 2.0}),
        ValueError,
        ["geometry holds 'thickness'", "'outer_radius'"],
    ),
    (
        "likelihood of a list of geometry",
        lambda: likelihood(geometry=[7.0]),
        TypeError,
        ["geometry must be a dict", "list"],
    ),
    # Layers and vectors.
    (
        "priors beside layers",
        lambda: layers(priors={"mu": pm.Uniform.dist(0, 50)}),
        TypeError,
        ["layers take their own priors", "Layer(..., mu=...)"],
    ),
    (
        "layers in a tube with an outer radius",
        lambda: layers(data=curves()),
        ValueError,
        ["layers state the thickness", "outer_radius=None"],
    ),
    (
        "layers and a prior of the outer radius",
        lambda: layers(geometry={"outer_radius": pm.Uniform.dist(8, 9)}),
        ValueError,
        ["layers state the thickness"],
    ),
    ("no layers", lambda: model(energy=[]), TypeError, ["ph.Layer(", "nothing"]),
    (
        "laws for layers",
        lambda: layers(NEO_HOOKEAN, OGDEN),
        TypeError,
        ["ph.Layer(", "Ogden()"],
    ),
    (
        "layers that would share a name",
        lambda: layers(*(ph.Layer(ph.NeoHookean(), 0.5, mu=mu) for mu in SHARED * 2)),
        ValueError,
        ["one name", "'mu'"],
    ),
    (
        "text in a layer",
        lambda: layers(ph.Layer(ph.NeoHookean(), 1.0, mu="stiff")),
        TypeError,
        ["mu_1 is 'stiff'", "a number", "distribution"],
    ),
    (
        "nan in a layer",
        lambda: layers(NEO_HOOKEAN, ph.Layer(ph.NeoHookean(), 1.0, mu=np.nan)),
        TypeError,
        ["mu_2 is nan", "a number"],
    ),
    (
        "a list for a number of a layer",
        lambda: layers(ph.Layer(ph.NeoHookean(), 1.0, mu=[3.0, 4.0])),
        TypeError,
        ["mu_1 is [3.0, 4.0]", "a number"],
    ),
    (
        "a short vector in a layer",
        lambda: layers(ph.Layer(SERIES, 1.0, mu=[3.0])),
        TypeError,
        ["mu_1 is [3.0]", "2 numbers"],
    ),
    (
        "a scalar prior of a vector in a layer",
        lambda: layers(ph.Layer(SERIES, 1.0, mu=pm.Uniform.dist(0, 50))),
        TypeError,
        ["'mu_1'", "shape ()", "2 entries", "shape=2"],
    ),
    (
        "classes of layers",
        lambda: fit({"C1": unknown_curves(outer_radius=None)}, energy=[NEO_HOOKEAN]),
        ValueError,
        ["class 'C1'", "layers", "do not make a class"],
    ),
    (
        "likelihood of layers",
        lambda: likelihood(energy=[NEO_HOOKEAN]),
        TypeError,
        ["ph.Ogden()", "Layer(NeoHookean()"],
    ),
    (
        "scalar prior of a vector",
        lambda: model(energy=SERIES, priors={"mu": pm.Uniform.dist(0, 50)}),
        TypeError,
        ["'mu'", "shape ()", "2 entries", "shape=2"],
    ),
    (
        "prior of a longer vector",
        lambda: model(energy=SERIES, priors={"alpha": pm.Uniform.dist(1, 9, shape=3)}),
        TypeError,
        ["'alpha'", "shape (3,)", "2 entries"],
    ),
    (
        "likelihood of a scalar for a vector",
        lambda: likelihood({"mu": 6.0, "alpha": np.array([2.0, 8.0])}, energy=SERIES),
        TypeError,
        ["'mu'", "2 entries"],
    ),
    # The likelihood in a model of one's own.
    (
        "likelihood outside a model",
        lambda: ph.inflation_likelihood(
            "curves", OGDEN, curves(), {"mu": 6.0, "alpha": 8.0}, **NOISE
        ),
        TypeError,
        ["with pm.Model():"],
    ),
    (
        "likelihood lacks a parameter",
        lambda: likelihood({"mu": 6.0}),
        TypeError,
        ["Ogden", "['mu', 'alpha']", "['mu'] were given"],
    ),
    (
        "likelihood of a list of parameters",
        lambda: likelihood(["mu", "alpha"]),
        TypeError,
        ["parameters", "dict", "['mu', 'alpha']"],
    ),
    (
        "likelihood of a vector",
        lambda: likelihood({"mu": np.array([6.0, 7.0]), "alpha": 6.0}),
        TypeError,
        ["'mu'", "1 dimension", "scalar"],
    ),
    (
        "likelihood of text",
        lambda: likelihood({"mu": "stiff", "alpha": 6.0}),
        TypeError,
        ["'mu' is 'stiff'", "random variable", "number"],
    ),
    (
        "likelihood of a class",
        lambda: likelihood(energy=ph.Ogden),
        TypeError,
        ["ph.Ogden()", "call the class"],
    ),
    (
        "likelihood with a vector of errors",
        lambda: likelihood(sigma=pm.HalfNormal.dist(shape=2)),
        TypeError,
        ["sigma", "1 dimension", "scalar"],
    ),
    (
        "likelihood's name is taken",
        lambda: likelihood(name="mu"),
        ValueError,
        ["mu", "already"],
    ),
    (
        "likelihood of nan",
        lambda: likelihood({"mu": np.nan, "alpha": 6.0}),
        ValueError,
        ["'mu' is nan", "finite"],
    ),
    # Sampling.
    ("data for a model", lambda: smc(curves()), TypeError, ["pm.Model", "Dataset"]),
    ("no draws", lambda: smc(draws=0), ValueError, ["draws is 0", "at least"]),
    ("one draw", lambda: smc(draws=1), ValueError, ["draws is 1", "at least"]),
    ("negative draws", lambda: smc(draws=-5), ValueError, ["draws is -5", "at least"]),
    ("half a draw", lambda: smc(draws=99.5), TypeError, ["draws is 99.5", "whole number"]),
    ("no chains", lambda: smc(chains=0), ValueError, ["chains is 0", "at least 1"]),
    ("half a chain", lambda: smc(chains=1.5), TypeError, ["chains is 1.5", "whole number"]),
    (
        "discrete variables",
        lambda: smc(model_of("discrete")),
        ValueError,
        ["continuous", "discrete: ['count']"],
    ),
    ("nothing free", lambda: smc(model_of("nothing free")), ValueError, ["free variables", "none"]),
    (
        "no likelihood",
        lambda: smc(model_of("no likelihood")),
        ValueError,
        ["nothing to temper", "[]"],
    ),
    (
        "impossible everywhere",
        lambda: smc(model_of("impossible")),
        ValueError,
        ["none of the 50", "finite likelihood", "50 are NaN", "prior", "unit"],
    ),
    (
        "prior that cannot be drawn",
        lambda: smc(model_of("flat")),
        ValueError,
        ["drawn from the prior", "proper"],
    ),
    (
        "unknown variable to keep",
        lambda: smc(var_names=["x", "y"]),
        ValueError,
        ["no variables ['y']", "['x']"],
    ),
    ("name for names", lambda: smc(var_names="x"), TypeError, ["var_names", "list", "'x'"]),
    (
        "unknown term to temper",
        lambda: smc(tempered=["new"]),
        ValueError,
        ["['likelihood']", "not ['new']"],
    ),
    ("threshold of one", lambda: smc(threshold=1.0), ValueError, ["threshold", "1.0"]),
    ("negative threshold", lambda: smc(threshold=-0.5), ValueError, ["threshold", "-0.5"]),
    ("no moves", lambda: smc(max_moves=0), ValueError, ["max_moves", "0"]),
    ("forgets too much", lambda: smc(forget=1.5), ValueError, ["forget", "1.5"]),
    ("text for a seed", lambda: smc(random_seed="lucky"), TypeError, ["random_seed", "'lucky'"]),
    ("negative seed", lambda: smc(random_seed=-1), ValueError, ["random_seed", "-1"]),
    (
        "start of too few chains",
        lambda: smc(chains=2, start=[{"x": np.zeros(50)}]),
        ValueError,
        ["start", "1", "2 chains"],
    ),
    (
        "start of another variable",
        lambda: smc(start=[{"y": np.zeros(50)}]),
        ValueError,
        ["start", "['x']", "['y']"],
    ),
    # Evidence and prediction.
    (
        "no evidence",
        lambda: ph.log_evidence(without("evidence")),
        ValueError,
        ["no evidence", "'posterior'", "ph.sample_smc"],
    ),
    (
        "evidence of all classes at once",
        lambda: ph.log_evidence(fitted()),
        ValueError,
        ["no evidence", "['C1', 'C2']", "ph.log_evidence(classes['C1'])"],
    ),
    (
        "evidence of a model",
        lambda: ph.log_evidence(plain_model()),
        TypeError,
        ["ph.sample_smc", "Model"],
    ),
    (
        "prediction of nobody knows what",
        lambda: predict(xr.DataTree.from_dict({"posterior": xr.Dataset()})),
        ValueError,
        ["strain energy", "energy=ph.Ogden()"],
    ),
    (
        "prediction of all classes at once",
        lambda: predict(fitted()),
        ValueError,
        ["no posterior", "['C1', 'C2']", "classes['C1']"],
    ),
    (
        "prediction of a model",
        lambda: predict(plain_model()),
        TypeError,
        ["ph.sample_smc", "Model"],
    ),
    (
        "prediction by a class",
        lambda: predict(energy=ph.Ogden),
        TypeError,
        ["ph.Ogden()", "call the class"],
    ),
    (
        "prediction by another law",
        lambda: predict(energy=ph.CriscioneType()),
        ValueError,
        ["['a', 'b']", "CriscioneType"],
    ),
    (
        "prediction without a tube",
        lambda: predict(without("constant_data"), inner_radius=7.0),
        ValueError,
        ["outer_radius"],
    ),
    (
        "prediction for many tubes",
        lambda: predict(fitted()["C2"]),
        ValueError,
        ["inner_radius", "do not have one"],
    ),
    (
        "prediction without wall",
        lambda: predict(outer_radius=6.0),
        ValueError,
        ["outer_radius must exceed inner_radius", "6.0"],
    ),
    (
        "prediction in a tube of text",
        lambda: predict(inner_radius="7 mm"),
        TypeError,
        ["inner_radius is '7 mm'", "number"],
    ),
    (
        "prediction at no radius",
        lambda: predict(radius=[8.0, 0.0]),
        ValueError,
        ["internal_radius", "positive", "0."],
    ),
    (
        "prediction at an unknown radius",
        lambda: predict(radius=[np.nan]),
        ValueError,
        ["internal_radius", "positive", "nan"],
    ),
    (
        "prediction at text",
        lambda: predict(radius="wide"),
        ValueError,
        ["internal_radius", "wide"],
    ),
    (
        "prediction on a grid",
        lambda: predict(radius=np.ones((2, 2))),
        ValueError,
        ["internal_radius", "list"],
    ),
    # Classes.
    ("no classes", lambda: fit({}), ValueError, ["classes", "dict", "{}"]),
    ("list of classes", lambda: fit([curves()]), TypeError, ["classes", "dict", "list"]),
    ("data for classes", lambda: fit(curves()), TypeError, ["classes", "dict", "Dataset"]),
    ("class without a name", lambda: fit({"": curves()}), ValueError, ["class", "text", "''"]),
    ("numbered class", lambda: fit({1: curves()}), ValueError, ["class", "text", "got 1"]),
    ("class with a slash", lambda: fit({"C/1": curves()}), ValueError, ["'/'", "'C/1'"]),
    (
        "one bad class",
        lambda: fit({"C1": curves(), "C2": with_nan()}),
        ValueError,
        ["class 'C2'", PLACE, "row 43", "pressure is nan kPa"],
    ),
    (
        "one class without data",
        lambda: fit({"C1": curves(), "C2": None}),
        TypeError,
        ["class 'C2'", "inflation_data("],
    ),
    (
        "one class too short",
        lambda: fit({"C1": curves(), "C2": curves([7.2, 7.6], [2.0, 4.0])}),
        ValueError,
        ["class 'C2'", PLACE, "at least 3"],
    ),
    (
        "prior that cannot be stored",
        lambda: fit(priors={"mu": pm.CustomDist.dist(1.0, logp=lambda x, m: -((x - m) ** 2))}),
        ValueError,
        ["'mu'", "cannot be stored", "pm.Gamma.dist(2, 0.1)"],
    ),
    (
        "error that cannot be stored",
        lambda: fit(sigma=pm.Truncated.dist(pm.HalfNormal.dist(), upper=2)),
        ValueError,
        ["'sigma'", "cannot be stored", "pm.Gamma.dist(2, 0.1)"],
    ),
    (
        "effect of experiments without variability",
        lambda: fit(experiment_effect=True),
        ValueError,
        ["experiment_effect is True", "only with variability='specimen'"],
    ),
    (
        "reference stress without variability",
        lambda: fit(reference_stress=30.0),
        ValueError,
        ["reference_stress is 30.0", "only with variability='specimen'"],
    ),
    ("no draws for classes", lambda: fit(draws=0), ValueError, ["draws is 0", "at least"]),
    ("seed for classes", lambda: fit(random_seed="x"), TypeError, ["random_seed", "'x'"]),
    # Classification.
    (
        "dict of fitted classes",
        lambda: classify(classes={"C1": fitted()["C1"]}),
        TypeError,
        ["ph.fit_classes", "dict"],
    ),
    (
        "tree without classes",
        lambda: classify(classes=xr.DataTree()),
        ValueError,
        ["ph.fit_classes", "no classes"],
    ),
    (
        "one class for all",
        lambda: classify(classes=fitted()["C1"]),
        ValueError,
        ["ph.fit_classes", "'observed_data' is no class"],
    ),
    ("classified by group", lambda: classify(by="group"), ValueError, ["'specimen'", "'group'"]),
    (
        "class prior of others",
        lambda: classify(class_prior={"C1": 0.5, "C3": 0.5}),
        ValueError,
        ["['C1', 'C3']", "['C1', 'C2']"],
    ),
    (
        "class prior adds up to two",
        lambda: classify(class_prior={"C1": 1.0, "C2": 1.0}),
        ValueError,
        ["add up to 1", "'C2': 1.0"],
    ),
    (
        "negative class prior",
        lambda: classify(class_prior={"C1": 1.5, "C2": -0.5}),
        ValueError,
        ["probabilities", "'C2': -0.5"],
    ),
    (
        "class prior in words",
        lambda: classify(class_prior={"C1": "half", "C2": "half"}),
        ValueError,
        ["probabilities", "'C1': 'half'"],
    ),
    (
        "list for class prior",
        lambda: classify(class_prior=[0.5, 0.5]),
        TypeError,
        ["class_prior", "dict", "[0.5, 0.5]"],
    ),
    (
        "new data altered",
        lambda: classify(with_nan()),
        ValueError,
        [PLACE, "row 43", "pressure is nan kPa"],
    ),
    (
        "new data too short",
        lambda: classify(curves([7.2, 7.6], [2.0, 4.0])),
        ValueError,
        [PLACE, "at least 3"],
    ),
    ("frame for new data", lambda: classify(pd.DataFrame()), TypeError, ["inflation_data("]),
    (
        "classes under different priors",
        lambda: classify(classes=altered("C2", "priors", "{}")),
        ValueError,
        ["class 'C2'", "priors {}", "one prior"],
    ),
    (
        "classes of different laws",
        lambda: ph.kl_divergence(altered("C2", "strain_energy", "Fung"), "C1", "C2"),
        ValueError,
        ["class 'C2'", "strain_energy Fung", "Ogden"],
    ),
    ("seed for classification", lambda: classify(random_seed=0.5), TypeError, ["random_seed"]),
    (
        "divergence from an unknown class",
        lambda: ph.kl_divergence(fitted(), "C1", "C3"),
        ValueError,
        ["no class 'C3'", "['C1', 'C2']"],
    ),
    (
        "divergence of no classes",
        lambda: ph.kl_divergence({"C1": 1, "C2": 2}, "C1", "C2"),
        TypeError,
        ["ph.fit_classes", "dict"],
    ),
]


@pytest.fixture(autouse=True)
def no_sampling(monkeypatch):
    """Fail as soon as a sampler takes its first step."""
    fitted()
    begun = "sampling began before the input was checked"
    monkeypatch.setattr(ph.BatchedSMC, "update_beta_and_weights", lambda kernel: pytest.fail(begun))


@pytest.mark.parametrize(
    ("call", "error", "fragments"), [row[1:] for row in BAD_INPUT], ids=[r[0] for r in BAD_INPUT]
)
def test_bad_input(call, error, fragments):
    """Each kind of bad input raises one error that names the place and what was expected."""
    with pytest.raises(error) as raised:
        call()
    message = str(raised.value)
    assert not [fragment for fragment in fragments if fragment not in message], message
