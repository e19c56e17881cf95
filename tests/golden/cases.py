"""Table of the cases whose numbers are recorded.

Every call of the package is in this file, uses public names only, and is mostly in the builder
functions. When the public interface changes, adapt the builders and keep the rows: the recorded
numbers must stay the same.

A row is a name and a function. A function of `DENSITIES` returns a PyMC model. A function of
`NUMBERS` returns deterministic numbers by name. A function of `SAMPLES` takes a seed and returns
random numbers by name, each with its standard error.
"""

from functools import cache, partial
from typing import NamedTuple

import arviz as az
import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr
from pytensor.compile.mode import Mode
from pytensor.graph.rewriting.db import RewriteDatabaseQuery

import pymc_hyperelastic as ph

# Evaluates a graph as it was built: compiling takes two thirds of the time of "FAST_COMPILE", and
# the numbers do not depend on graph rewrites.
AS_WRITTEN = Mode("py", RewriteDatabaseQuery(include=["minimum_compile", "merge"]))


def aorta(**labels):
    """Tests of the simulated sheep aortas: 20 points each, without forces and opening angle."""
    labels = labels or {"specimen": "S1", "experiment": [1, 2]}
    return ph.select(ph.load_dataset("simulated_sheep_aorta"), **labels)


def artery(*, specimens="A", outer=1.3, extension=False, force=True, by="radius", **geometry_sd):
    """Made-up tests of an artery at several axial stretches, with pressures and axial forces.

    The curves are those of an exponential material by membrane theory at the middle of the wall, so
    that the data do not depend on the package, with seeded errors of 0.2 kPa and 1 mN.
    """
    rng, tables = np.random.default_rng(5), []
    # Radii (mm), opening angle (rad), moduli (kPa) and exponent: those of a large mouse artery.
    inner, outside, angle, modulus, exponent = 1.0, 1.3, 0.8, {"A": 12.0, "B": 16.0}, 0.8
    factor, points = 2 * np.pi / (2 * np.pi - angle), 8
    tests = [(np.linspace(1.05, 1.5, points), np.full(points, axial)) for axial in (1.3, 1.5)]
    if extension:
        tests.append((np.linspace(1.3, 1.2, points), np.linspace(1.2, 1.5, points)))
    for specimen in specimens:
        for experiment, (radius, axial) in enumerate(tests, start=1):
            area = (outside**2 - inner**2) / (factor * axial)
            current_outer, middle = np.sqrt(radius**2 + area), np.sqrt(radius**2 + area / 2)
            hoop2 = factor**2 * middle**2 / ((inner**2 + outside**2) / 2)
            radial2 = 1 / (hoop2 * axial**2)
            stress = modulus[specimen] * np.exp(exponent * (radial2 + hoop2 + axial**2 - 3))
            pressure = stress * (hoop2 - radial2) * (current_outer - radius) / middle
            tension = stress * (2 * axial**2 - hoop2 - radial2) * np.pi * area / 2
            columns = {"radius": radius, "outer_diameter": 2 * current_outer, "axial": axial}
            columns["pressure"] = pressure + 0.2 * rng.standard_normal(points)
            columns["axial_force"] = tension + rng.standard_normal(points)
            labels = {"specimen": specimen, "experiment": experiment}
            tables.append(pd.DataFrame(labels | columns))
    frame = pd.concat(tables, ignore_index=True)
    stated = {"opening_angle": angle, "convention": "whole", "radii_of": "sector"}
    tube = ph.Tube(inner, outer, axial_stretch="axial", **stated, sd=geometry_sd)
    frame = frame if force else frame.drop(columns="axial_force")
    return ph.inflation_data(frame, tube, measured=by, check="ignore")


HGO, GOH, FUNG = "HolzapfelGasserOgden", "GasserOgdenHolzapfel", "FungOrthotropic"
FIBRES = {"c": 3.0, "k1": 4.0, "k2": 0.5, "beta": 29.0}
FOUR = {"c": 10.0, "k1_axial": 8.0, "k2_axial": 0.05, "k1_hoop": 6.0, "k2_hoop": 0.1}
FOUR |= {"k1_diagonal": 1.0, "k2_diagonal": 0.5, "beta": 40.0}
# Every law, with material parameters of a soft tube.
LAWS = {
    "NeoHookean": {"mu": 20.0},
    "MooneyRivlin": {"c10": 10.0, "c01": 1.5},
    "Yeoh": {"c1": 10.0, "c2": 15.0, "c3": 5.0},
    "Gent": {"mu": 15.0, "limit": 60.0},
    "Demiray": {"mu": 20.0, "b": 1.0},
    "ArrudaBoyce": {"mu": 20.0, "lock": 3.0},
    "PowerLawNeoHookean": {"mu": 20.0, "n": 4.0},
    "Ogden": {"mu": 6.0, "alpha": 8.0},
    "OgdenSeries(1)": {"mu": (6.0,), "alpha": (8.0,)},
    "OgdenSeries(2)": {"mu": (20.0, -3.0), "alpha": (2.0, -2.0)},
    "OgdenSeries(3)": {"mu": (617.8, 1.18, -9.81), "alpha": (1.3, 5.0, -2.0)},
    "CriscioneType": {"a": 3.0, "b": 4.0},
    FUNG: {"c": 25.0, "a1": 1.0, "a2": 0.5, "a4": 0.1},
    HGO: FIBRES,
    GOH: FIBRES | {"kappa": 0.1},
    "FourFiber": FOUR,
}


class Cubic(ph.StrainEnergy):
    """A law that a user defines by its energy alone."""

    parameters = (
        ph.Parameter("k", "k", "kPa", (0.0, 100.0), "modulus"),
        ph.Parameter("m", "m", "kPa", (0.0, 100.0), "modulus at larger strain"),
    )

    def energy(self, radial, hoop, axial, *, k, m):
        excess = radial**2 + hoop**2 + axial**2 - 3
        return k * excess + m * excess**3


def law(energy):
    """Strain energy of a name; anything else is returned as it is."""
    if not isinstance(energy, str):
        return energy
    if energy.startswith("OgdenSeries"):
        return ph.OgdenSeries(terms=int(energy[-2]))
    return Cubic() if energy == "Cubic" else getattr(ph, energy)()


def layers(outer=HGO, thickness=0.1, **parameters):
    """A wall of two layers: a known one, and one whose unknown parameters have default priors."""
    inner = ph.Layer(ph.NeoHookean(), 0.2, mu=15.0)
    return [inner, ph.Layer(law(outer), thickness, **parameters)]


# Arguments of likelihoods; the other settings of a row are arguments of the model.
SIZES = ("pressure_sd", "force_sd", "force_offset_sd", "diameter_sd", "sigma", "slope_weight")
ERRORS = (*SIZES, "force_sigma", "radius_sd", "observed")


def split(settings):
    """Likelihood of the errors among settings, by default of 0.5 kPa, and the other settings.

    With slopes standard deviations become the paper's sigma.
    """
    errors = {name: value for name, value in settings.items() if name in ERRORS}
    others = {name: value for name, value in settings.items() if name not in ERRORS}
    weight = errors.pop("slope_weight", 0.0)
    if isinstance(weight, float) and weight == 0.0:
        default = {} if "radius_sd" in errors else {"pressure_sd": 0.5}
        return ph.Gaussian(**default | errors), others
    for name, sigma in (("pressure_sd", "sigma"), ("force_sd", "force_sigma")):
        default = {"pressure_sd": 0.5}.get(name)
        sd = errors.pop(name, None if sigma in errors else default)
        if sd is not None:
            errors[sigma] = np.sqrt(2) * sd
    return ph.SlopeAugmented(slope_weight=weight, **errors), others


def inflation(energy, data=None, /, **settings):
    """Model in which all tests share the parameters: by default errors of 0.5 kPa, no slopes."""
    data = aorta() if data is None else data
    likelihood, others = split(settings)
    return ph.inflation_model(law(energy), data, likelihood, **others)


def slopes(energy, data=None, /, **settings):
    """Model of `inflation` with slopes in the likelihood."""
    return inflation(energy, data, **{"slope_weight": 1.5} | settings)


def forces(energy, data=None, /, **settings):
    """Model of `inflation` for an artery with axial forces that have errors of 5 mN."""
    data = artery() if data is None else data
    return inflation(energy, data, **FORCE | settings)


def generative(energy, data=None, /, **settings):
    """Generative likelihood of pressures, slopes and axial forces."""
    return forces(energy, data, observed=True, **{"slope_weight": 0.01} | settings)


def population(energy, data=None, /, **settings):
    """Model in which specimens differ."""
    data = aorta(group="C1", experiment=[1, 2]) if data is None else data
    likelihood, others = split(settings)
    return ph.population_model(law(energy), data, likelihood, **others)


def two_arteries():
    """Two inflation models with one exponent, as named parts of a larger model."""
    with pm.Model() as model:
        alpha = pm.Uniform("alpha", 0, 40)
        for group in ("C1", "C2"):
            inflation("Ogden", aorta(group=group), priors={"alpha": alpha}, name=group)
    return model


def own_model(data=None, /, *, tube=None, **settings):
    """A user's model that adds the likelihood of the curves to its own variables."""
    with pm.Model() as model:
        parameters = {"mu": pm.LogNormal("mu", 2.0, 1.0), "alpha": pm.Normal("alpha", 6.0, 3.0)}
        noise = pm.HalfNormal("noise", 1.0)
        errors = {} if "radius_sd" in settings else {"pressure_sd": noise}
        likelihood, others = split(errors | settings)
        parameters |= {n: pm.Normal(n, *prior) for n, prior in (tube or {}).items()}
        data = aorta() if data is None else data
        ph.inflation_likelihood("curves", law("Ogden"), data, likelihood, parameters, **others)
    return model


def priors(family, /, **arguments):
    """Distributions of one family by the names of parameters."""
    return {name: family.dist(*np.ravel(given)) for name, given in arguments.items()}


def measured(**errors):
    """Priors of a tube that was measured, with standard errors; None for those of the data."""
    return {"priors": {name: ph.MeasuredValue(error) for name, error in errors.items()}}


uniform, half_normal = partial(priors, pm.Uniform), partial(priors, pm.HalfNormal)
log_normal = partial(priors, pm.LogNormal)
# Data of two specimens, with outer diameters, with an extension test, of an unknown outer radius.
two, diameters = partial(artery, specimens="AB"), partial(artery, by="outer_diameter")
extended, unlayered = partial(artery, extension=True), partial(artery, outer=None)
FORCE, EFFECT = {"force_sd": 5.0}, {"variability": ph.Variability(experiment_effect=True)}
OFFSET, DIAMETER = {"force_offset_sd": 30.0}, {"diameter_sd": 0.02}
GENERATIVE, RADIUS = {"observed": True}, {"radius_sd": 0.05}


def unknown(**ranges):
    """Uniform priors of a tube."""
    return {"priors": uniform(**ranges)}


def mild():
    """Setting of priors with which pressures of four families of fibres do not overflow."""
    return {"priors": uniform(k2_axial=(0, 2), k2_hoop=(0, 2), k2_diagonal=(0, 2))}


DENSITIES = {
    **{f"paper, slopes, {name}": partial(slopes, name) for name in LAWS},
    **{f"generative, forces, {name}": partial(generative, name) for name in LAWS},
    "generative, forces, FourFiber": lambda: generative("FourFiber", **mild()),
    "paper, forces, FourFiber": lambda: forces("FourFiber", **mild()),
    "paper, forces, HGO": lambda: forces(HGO),
    "paper, forces": lambda: forces("Ogden"),
    "paper, forces, slopes": lambda: forces(FUNG, slope_weight=0.01),
    "paper, sigma": lambda: slopes("Ogden", sigma=0.8),
    "paper, collocation": lambda: inflation("Ogden", mode="collocation"),
    "paper, quadrature": lambda: inflation("Ogden", mode="quadrature"),
    "paper, overflow": lambda: forces("FourFiber"),
    "generative, pressures": lambda: inflation("Ogden", **GENERATIVE),
    "generative, slopes": lambda: slopes("Ogden", **GENERATIVE),
    "rising": lambda: inflation("PowerLawNeoHookean", rising=True),
    "priors": lambda: inflation("OgdenSeries(2)", priors={"mu": pm.Normal.dist(5, 9, shape=2)}),
    "two arteries": two_arteries,
    "offset, paper": lambda: forces("Ogden", **OFFSET),
    "offset, generative": lambda: generative("Demiray", **OFFSET),
    "offset, inferred": lambda: forces("Ogden", **half_normal(force_offset_sd=50)),
    "thickness": lambda: inflation("Ogden", **unknown(inner_radius=(6, 8), thickness=(1, 3))),
    "wall area": lambda: slopes("Ogden", **unknown(inner_radius=(6, 8), wall_area=(50, 150))),
    "outer radius": lambda: slopes("Ogden", **unknown(outer_radius=(8, 10))),
    "opening angle": lambda: forces("Demiray", **unknown(opening_angle=(0.1, 2))),
    "axial stretch": lambda: forces("Ogden", **unknown(axial_stretch=(1, 1.8))),
    "measured thickness": lambda: generative("Demiray", two(), **measured(thickness=0.02)),
    "measured angle": lambda: forces(HGO, two(), **measured(opening_angle=0.1, axial_stretch=0.02)),
    "measured, in data": lambda: forces("Ogden", two(thickness=0.02), **measured(thickness=None)),
    "diameters, slopes": lambda: slopes("Ogden", diameters(), pressure_sd=5.0),
    "diameters, radius": lambda: forces("Ogden", diameters(), **unknown(inner_radius=(0.9, 1.1))),
    "diameter noise, pressures": lambda: inflation("Ogden", diameters(force=False), **DIAMETER),
    "diameter noise, forces": lambda: forces("Demiray", diameters(), **DIAMETER),
    "diameter noise, all": lambda: forces(FUNG, diameters(), **DIAMETER, **OFFSET, **GENERATIVE),
    "diameter noise, inferred": lambda: forces(
        "Ogden", diameters(), **half_normal(diameter_sd=0.05)
    ),
    "radius error": lambda: inflation("Ogden", **RADIUS),
    "radius error, forces": lambda: forces("Demiray", **RADIUS),
    "radius error, diameters": lambda: forces("Demiray", diameters(), **RADIUS),
    "extension, pressures": lambda: inflation("Ogden", extended(force=False)),
    "extension, paper": lambda: forces(HGO, extended(), slope_weight=0.01),
    "extension, generative": lambda: generative("Demiray", extended()),
    "extension, diameters": lambda: forces("Demiray", extended(by="outer_diameter"), **DIAMETER),
    "layers, paper": lambda: forces(layers(), unlayered(), slope_weight=0.01),
    "layers, generative": lambda: generative(layers(), unlayered()),
    "layer thickness": lambda: forces(
        layers("Demiray", **log_normal(thickness=(-2.3, 0.3))), unlayered()
    ),
    "noise": lambda: inflation("Ogden", **half_normal(pressure_sd=1)),
    "noise, slope weight": lambda: inflation("Ogden", **half_normal(sigma=1, slope_weight=2)),
    "noise, generative": lambda: generative("Ogden", **half_normal(sigma=np.sqrt(2))),
    "noise, forces": lambda: forces("Demiray", **half_normal(pressure_sd=1, force_sd=10)),
    "population": lambda: population("Ogden"),
    "population, experiments": lambda: population("Ogden", **EFFECT),
    "population, own logarithms": lambda: population(
        "Demiray", variability=ph.Variability(reference_stress=None)
    ),
    "population, slopes": lambda: population("Yeoh", slope_weight=1.5),
    "population, noise": lambda: population(
        "PowerLawNeoHookean", two(), **log_normal(pressure_sd=(-1, 0.5), force_sd=(2, 0.5))
    ),
    "population, offset": lambda: population("Demiray", two(), **FORCE, **OFFSET, **EFFECT),
    "population, diameters": lambda: population(
        "Demiray", two(by="outer_diameter"), **DIAMETER, **measured(thickness=0.02)
    ),
    "population, layers": lambda: population(layers(), two(outer=None), **FORCE),
    "own model": own_model,
    "own model, forces": lambda: own_model(artery(), slope_weight=0.01, **FORCE, **OFFSET),
    "own model, geometry": lambda: own_model(artery(), tube={"inner_radius": (1, 0.05)}),
    "own model, radius error": lambda: own_model(**RADIUS),
    "own law, paper": lambda: slopes("Cubic"),
    "own law, generative": lambda: generative("Cubic"),
    "own law, population": lambda: population("Cubic"),
}

# Value variables of recorded points that have another name now, and the difference of their values:
# by case, or of all cases. A standard deviation became the paper's sigma, or the other way round.
HALF_LOG_2 = np.log(2) / 2
RENAMED = {
    "": {
        "noise_sd_log__": ("pressure_sd_log__", 0.0),
        "force_noise_sd_log__": ("force_sd_log__", 0.0),
        "diameter_noise_sd_log__": ("diameter_sd_log__", 0.0),
        "log_specimen_sigma": ("log_specimen_pressure_sd", -HALF_LOG_2),
        "log_specimen_force_sigma": ("log_specimen_force_sd", -HALF_LOG_2),
    },
    "noise, generative": {"noise_sd_log__": ("sigma_log__", HALF_LOG_2)},
}

# Points that are not searched for, by case: near the upper ends of all priors pressures overflow.
STATED = {"paper, overflow": [{f"{name}_interval__": 6.0 for name in FOUR}]}

# From a compressed wall, in which fibres slacken, to a hoop stretch of about 1.7.
RADII = [0.8, 1.05, 1.5]
TUBE = {"inner_radius": 1.0, "axial_stretch": 1.3, "opening_angle": 1.0}
WHOLE = {"outer_radius": 1.4}


def mechanics(energy, outer_radius=None, **material):
    """Pressure (kPa), stiffness (kPa/mm) and axial force (mN) of a tube at `RADII` (mm)."""
    functions = ph.inflation_pressure, ph.inflation_stiffness, ph.axial_force
    tube = ph.Tube(outer_radius=outer_radius, **TUBE)
    values = (f(law(energy), RADII, tube, **material).eval(mode=AS_WRITTEN) for f in functions)
    return dict(zip(("pressure", "stiffness", "axial force"), values, strict=True))


def predictions(name):
    """Predictions from two given draws of the material parameters of a law."""
    draws = {key: (("chain", "draw"), [[x, 1.1 * x]]) for key, x in LAWS[name].items()}
    tree = xr.DataTree.from_dict({"posterior": xr.Dataset(draws)})
    energy, tube = law(name), ph.Tube(**TUBE, **WHOLE)
    at = ph.Conditions([2.0, 6.0], pressure_range=(3, 5), tube=tube)
    results = {
        "curve": ph.predict_pressure(tree, RADII, tube=tube, energy=energy),
        "force": ph.predict_axial_force(tree, RADII, tube=tube, energy=energy),
        "inverse": ph.radius_at_pressure(tree, at, energy=energy),
        "properties": ph.tube_properties(tree, at, energy=energy),
        "stress": ph.wall_stress(tree, at, points=3, energy=energy),
    }
    return {f"{kind}, {n}": x.values for kind, r in results.items() for n, x in r.items()}


def exact(name):
    """Log evidence of one or two parameters by quadrature."""
    return {"log evidence": ph.log_evidence_by_quadrature(TO_SAMPLE[name]()).value}


NUMBERS = {
    **{f"mechanics, {n}": partial(mechanics, n, **WHOLE, **LAWS[n]) for n in LAWS},
    "mechanics, own law": lambda: mechanics("Cubic", **WHOLE, k=10.0, m=2.0),
    "mechanics, layers": lambda: mechanics(layers("FourFiber", **FOUR)),
    "predictions of draws, Fung": partial(predictions, FUNG),
    "predictions of draws, HGO": partial(predictions, HGO),
    "slope weight": lambda: {"slope weight": ph.balanced_slope_weight(aorta())},
    "quadrature, NeoHookean": partial(exact, "NeoHookean"),
    "quadrature, Ogden": partial(exact, "Ogden"),
}


class Sampled(NamedTuple):
    """A random number, its standard error, and the unit in which differences are judged.

    The unit is 1 for log evidences (nats) and probabilities, the posterior standard deviation for
    moments of a posterior, and infinite for numbers that are judged by their standard error alone.
    """

    value: float
    standard_error: float
    unit: float = 1.0


# Draws of a chain: the standard errors of log evidences are then mostly below 0.02 nats.
SETTINGS = {"draws": 2000, "chains": 2, "progressbar": False}


def positive(**ranges):
    """Model of Ogden's law with a positive exponent; both signs mean the same."""
    return inflation("Ogden", priors=uniform(alpha=(0, 40), **ranges))


TO_SAMPLE = {
    "Ogden": positive,
    "two modes": lambda: slopes("Ogden"),
    "tempering": positive,
    "NeoHookean": lambda: inflation("NeoHookean", pressure_sd=2.0),
    "HGO": lambda: forces(HGO, priors=uniform(k2=(0, 5), beta=(25, 60))),
    "forces": lambda: generative("Demiray", **OFFSET),
    "geometry": lambda: positive(inner_radius=(6.5, 7.5)),
    "layers": lambda: forces(layers("Demiray"), unlayered()),
}


@cache
def draws(name, seed):
    """A model of `TO_SAMPLE`, and draws of its posterior."""
    model = TO_SAMPLE[name]()
    settings = SETTINGS | {"random_seed": seed, "from_modes": name != "tempering"}
    return model, ph.sample_smc(model, **settings)


def moments(variables):
    """Posterior means and standard deviations of draws by name."""
    result = {}
    for name, values in variables.items():
        for i, x in enumerate(np.moveaxis(values.values.reshape(*values.shape[:2], -1), -1, 0)):
            errors = [float(az.mcse(x, method=method)) for method in ("mean", "sd")]
            result[f"{name} {i}, mean"] = Sampled(x.mean(), errors[0], x.std())
            result[f"{name} {i}, sd"] = Sampled(x.std(), errors[1], x.std())
    return result


def sampled(name, seed):
    """Log evidences of a model, by SMC and by bridge sampling, and moments of its parameters."""
    model, tree = draws(name, seed)
    bridge = ph.bridge_sampling(model, tree, random_seed=seed)
    result = {"SMC": Sampled(*ph.log_evidence(tree)), "bridge": Sampled(*bridge)}
    # The posterior of Ogden's exponent is symmetric.
    return result | moments({v.name: abs(tree["posterior"][v.name]) for v in model.free_RVs})


def predicted(name, seed):
    """Moments of pressures at two radii (mm), and of properties at 10 kPa."""
    _, tree = draws(name, seed)
    names = ["radius", "compliance", "pulse_wave_velocity", "incremental_modulus"]
    properties = ph.tube_properties(tree, 10.0)[names]
    return moments(ph.predict_pressure(tree, [8, 9])) | moments(properties)


# Two training specimens for each class, and a new specimen. Errors (kPa) are chosen so that the
# class of the new specimen stays uncertain.
TRAINING, NEW = {"C1": ["S1", "S2"], "C2": ["S4", "S5"]}, "S3"
POOLED, SPECIMENS = {"likelihood": 8.0}, {"likelihood": 0.5, "variability": "specimen"}


@cache
def classes(kind, seed):
    """Two fitted classes."""
    training = {name: aorta(specimen=specimens) for name, specimens in TRAINING.items()}
    own = POOLED | {"priors": uniform(alpha=(0, 40))} if kind == "pooled" else SPECIMENS
    return ph.fit_classes(law("Ogden"), training, **SETTINGS, **own, random_seed=seed)


def classified(kind, seed):
    """Log evidences of the classes, and log evidences and probabilities of them for new data."""
    fitted = classes(kind, seed)
    result = {name: Sampled(*ph.log_evidence(fitted[name])) for name in TRAINING}
    # With variability the standard errors are 0.04 nats, however many draws the class has.
    unit = 1.0 if kind == "pooled" else np.inf
    settings = {"random_seed": seed, "progressbar": False}
    for by in ("test", "specimen"):
        answer = ph.classify(aorta(specimen=NEW), fitted, by=by, **settings)
        for name in ("log_evidence", "class_probability"):
            pairs = zip(answer[name].values.flat, answer[f"{name}_se"].values.flat, strict=True)
            result |= {f"{name} by {by}, {i}": Sampled(*p, unit) for i, p in enumerate(pairs)}
    return result


def divergence(seed):
    """Kullback-Leibler divergence of the posterior of one class from that of the other."""
    divergence = ph.kl_divergence(classes("pooled", seed), *TRAINING)
    # Its standard error is 0.06 nats: two runs differ by more than 0.1 by chance.
    return {"divergence": Sampled(*divergence, np.inf)}


def differences(seed):
    """Differences of two classes, and their Bayes factor."""
    settings = {"at": 5.0, "draws": 2000, "random_seed": seed}
    quantities = ["log_alpha", "log compliance"]
    found = ph.compare_classes(classes("specimens", seed), quantities, **settings)
    factor = found["log_bayes_factor"].item(), found["log_bayes_factor_se"].item()
    result = {"log Bayes factor": Sampled(*factor)}
    for statistic in ("typical", "mean"):
        for quantity in quantities:
            at = found.sel(statistic=statistic, quantity=quantity).isel(comparison=0)
            sd = at["difference_sd"].item()
            # The difference is a median, with the standard error of that of independent draws.
            error = sd * np.sqrt(np.pi / 2 / found.sizes["draw"])
            result[f"{statistic} {quantity}"] = Sampled(at["difference"].item(), error, np.inf)
    return result


def information(seed):
    """Expected information of two designs about a parameter."""
    designs = {"one": {"pressure": 10, "points": 1}, "curve": {"pressure": (2, 16)}}
    settings = {"about": "log_alpha", "specimens": 100, "draws": 128, "random_seed": seed}
    found = ph.expected_information(classes("specimens", seed), designs, **settings)
    by_design = [found.sel(design=name) for name in designs]
    return {
        name: Sampled(at["information"].item(), at["information_se"].item(), np.inf)
        for name, at in zip(designs, by_design, strict=True)
    }


SAMPLES = {
    **{f"sampled, {name}": partial(sampled, name) for name in TO_SAMPLE},
    "offsets": lambda seed: moments(ph.force_offsets(draws("forces", seed)[1])),
    "predictions, Ogden": partial(predicted, "Ogden"),
    "predictions, geometry": partial(predicted, "geometry"),
    "classes, pooled": partial(classified, "pooled"),
    "classes, specimens": partial(classified, "specimens"),
    "divergence": divergence,
    "differences": differences,
    "information": information,
}
