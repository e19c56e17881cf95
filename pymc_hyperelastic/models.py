"""PyMC model factories."""

from functools import cache
from numbers import Real
from typing import Any

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.collocation import CollocatedPressureIntegral, curve_matrices
from pymc_hyperelastic.data import GEOMETRY, describe_test
from pymc_hyperelastic.likelihood import (
    Mode,
    check_likelihood,
    nodes_for,
    register_likelihood,
)
from pymc_hyperelastic.pressure import PressureIntegral, check_geometry
from pymc_hyperelastic.priors import check_prior, complete_priors, is_inferred, register_prior
from pymc_hyperelastic.results import Study, check_result, inflation_data_of
from pymc_hyperelastic.strain_energy import CriscioneType, Ogden, PowerLawNeoHookean, StrainEnergy

__all__ = [
    "criscione_model",
    "inflation_model",
    "ogden_model",
    "power_law_neo_hookean_model",
    "predict_pressure",
]


def inflation_model(
    energy: StrainEnergy,
    data: xr.Dataset,
    *,
    sigma: Any,
    slope_weight: Any,
    priors: dict[str, Any] | None = None,
    mode: Mode = "auto",
) -> pm.Model:
    r"""PyMC model of inflation curves: every test shares one set of material parameters.

    The model holds one random variable for each parameter, the deterministics ``pressure`` and
    ``stiffness`` over ``obs``, and the Potential ``likelihood`` (see
    :func:`~pymc_hyperelastic.inflation_likelihood`). Any PyMC sampler takes it.

    Parameters
    ----------
    energy : StrainEnergy
        The material, such as ``ph.Ogden()``, or one of your own.
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`.
    sigma : float or distribution
        The paper's ``σ``, kPa. With a distribution, such as ``pm.HalfNormal.dist(1)``, it is
        inferred.
    slope_weight : float or distribution
        The paper's ``β``, mm², likewise; 0 leaves the slopes out.
    priors : dict of str to distribution, optional
        Priors by parameter name, such as ``{"mu": pm.Uniform.dist(0, 50)}``. For the others the
        default of the strain energy is taken: uniform over a documented physical range.
    mode : {"auto", "collocation", "quadrature"}
        How the wall is integrated, see :func:`~pymc_hyperelastic.inflation_likelihood`.

    Returns
    -------
    pymc.Model
        With the dimension ``obs`` (points) and ``test`` (experiments).

    Raises
    ------
    TypeError
        If the strain energy, the data or a prior is not one.
    ValueError
        If the data are unsound, a prior belongs to no parameter, or a number is impossible.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> model = ph.inflation_model(ph.Ogden(), data, sigma=5 * ph.mmHg, slope_weight=1.0)
    >>> [rv.name for rv in model.free_RVs]
    ['mu', 'alpha']
    """
    PressureIntegral(strain_energy=energy)  # it says so if this is no strain energy
    distributions = complete_priors(energy, priors)
    check_likelihood(energy, data, distributions, sigma=sigma, slope_weight=slope_weight)
    nodes = nodes_for(energy, data, distributions, mode)
    coords = {
        "obs": np.arange(data.sizes["obs"]),
        "test": [describe_test(data, test) for test in range(data.sizes["test"])],
    }
    with pm.Model(coords=coords) as model:
        parameters = {name: register_prior(name, prior) for name, prior in distributions.items()}
        noise = {"sigma": sigma, "slope_weight": slope_weight}
        for name, value in noise.items():
            if is_inferred(value):
                check_prior(name, value)
                noise[name] = register_prior(name, value)
        pressure, stiffness = _curves(energy, data, nodes, parameters)
        pm.Deterministic("pressure", pressure, dims="obs")
        pm.Deterministic("stiffness", stiffness, dims="obs")
        register_likelihood("likelihood", energy, data, nodes, parameters, **noise)
    model.study = Study(energy, data, distributions, {"sigma": sigma, "slope_weight": slope_weight})
    return model


def power_law_neo_hookean_model(data: xr.Dataset, **settings: Any) -> pm.Model:
    """Model of the power-law neo-Hookean tube; see :func:`inflation_model` for the settings.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> model = ph.power_law_neo_hookean_model(data, sigma=5 * ph.mmHg, slope_weight=1.0)
    """
    return inflation_model(PowerLawNeoHookean(), data, **settings)


def ogden_model(data: xr.Dataset, **settings: Any) -> pm.Model:
    """Model of the Ogden tube; see :func:`inflation_model` for the settings.

    The posterior is symmetric in ``alpha``: with the default prior it has two mirrored modes.
    For NUTS, which cannot jump between them, give a one-sided prior: the evidence is the same.

    Examples
    --------
    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> model = ph.ogden_model(
    ...     data, sigma=5 * ph.mmHg, slope_weight=1.0, priors={"alpha": pm.Uniform.dist(0, 40)}
    ... )
    """
    return inflation_model(Ogden(), data, **settings)


def criscione_model(data: xr.Dataset, **settings: Any) -> pm.Model:
    """Model of the Criscione-type tube; see :func:`inflation_model` for the settings.

    The posterior is symmetric in ``b``; see :func:`ogden_model`.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> model = ph.criscione_model(data, sigma=5 * ph.mmHg, slope_weight=1.0)
    """
    return inflation_model(CriscioneType(), data, **settings)


def predict_pressure(
    tree: xr.DataTree,
    internal_radius: Any,
    *,
    energy: StrainEnergy | None = None,
    inner_radius: float | None = None,
    outer_radius: float | None = None,
    axial_stretch: float | None = None,
    opening_angle: float | None = None,
) -> xr.Dataset:
    """Posterior of the tube's pressure and stiffness at new radii, without measurement error.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model: of :func:`pymc_hyperelastic.sample_smc`, a class of
        :func:`pymc_hyperelastic.fit_classes`, or any result with a ``posterior`` group.
    internal_radius : array_like, shape (radius,)
        Current internal radii, mm.
    energy : StrainEnergy, optional
        The material; needed where the result does not name it.
    inner_radius, outer_radius, axial_stretch, opening_angle : float, optional
        The tube (mm, rad). Where missing it is that of the result's data, which must be the same
        for all its tests; without data the axial stretch is 1 and the opening angle 0.

    Returns
    -------
    xarray.Dataset
        ``pressure`` (kPa) and ``stiffness`` (kPa/mm) with dimensions (chain, draw, radius).

    Raises
    ------
    TypeError
        If `tree` is no DataTree or `energy` no strain energy.
    ValueError
        If the strain energy or the geometry is not known, or a parameter is not in the posterior,
        or a radius is impossible.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    >>> model = ph.ogden_model(data, sigma=5 * ph.mmHg, slope_weight=3.0)
    >>> tree = ph.sample_smc(model, draws=500, chains=2, random_seed=1, progressbar=False)
    >>> curve = ph.predict_pressure(tree, [8.0, 9.0])
    >>> curve["pressure"].dims
    ('chain', 'draw', 'radius')
    """
    check_result(tree)
    if "posterior" not in tree.children:
        raise ValueError(
            f"the result has no posterior; its groups are {sorted(tree.children)} (for a class: "
            "ph.predict_pressure(classes['C1'], ...))"
        )
    energy = energy or _energy_of(tree)
    PressureIntegral(strain_energy=energy)  # it says so if this is no strain energy
    posterior = tree["posterior"].to_dataset()
    lacking = [name for name in energy.parameter_names if name not in posterior]
    if lacking:
        raise ValueError(f"the posterior lacks {lacking}, parameters of {energy.name}")
    geometry = _common_geometry(tree) | {
        name: value
        for name, value in {
            "inner_radius": inner_radius,
            "outer_radius": outer_radius,
            "axial_stretch": axial_stretch,
            "opening_angle": opening_angle,
        }.items()
        if value is not None
    }
    for name, value in geometry.items():
        if not isinstance(value, Real | None):
            raise TypeError(f"{name} is {value!r}; expected a number")
    unknown = [name for name, value in geometry.items() if value is None]
    if unknown:
        raise ValueError(
            f"the result's data do not have one {' and one '.join(unknown)}: give what is meant, "
            f"{', '.join(name + '=...' for name in unknown)}"
        )
    try:
        radius = np.atleast_1d(np.asarray(internal_radius, float))
        sound = radius.ndim == 1 and bool(np.all(np.isfinite(radius) & (radius > 0)))
    except (TypeError, ValueError):
        sound = False
    if not sound:
        raise ValueError(
            f"internal_radius must be a list of positive radii in mm; got {internal_radius!r}"
        )
    check_geometry(internal_radius=radius, **geometry)
    response = _response_function(energy)(
        radius,
        *(np.float64(value) for value in geometry.values()),
        *(posterior[name].values[..., None] for name in energy.parameter_names),
    )
    units = {"pressure": "kPa", "stiffness": "kPa/mm"}
    return xr.Dataset(
        {
            name: (("chain", "draw", "radius"), values, {"units": units[name], "long_name": name})
            for name, values in zip(units, response, strict=True)
        },
        {
            "chain": posterior["chain"],
            "draw": posterior["draw"],
            "radius": ("radius", radius, {"units": "mm", "long_name": "internal radius"}),
        },
    )


def _curves(
    energy: StrainEnergy, data: xr.Dataset, nodes: int | None, parameters: dict[str, Any]
) -> list[TensorVariable]:
    """Pressure and stiffness at the points of the data."""
    if nodes is None:
        points = data["test"].values
        geometry = (data[name].values[points] for name in GEOMETRY)
        integral = PressureIntegral(strain_energy=energy)
        return integral(data["radius"].values, *geometry, *parameters.values())
    matrices, place = curve_matrices(data, nodes)
    shared = (pytensor.shared(value, name=f"curve_{key}") for key, value in matrices.items())
    curves = CollocatedPressureIntegral(strain_energy=energy)(*shared, *parameters.values())
    return [curve.flatten()[place] for curve in curves]


def _energy_of(tree: xr.DataTree) -> StrainEnergy:
    if "strain_energy" not in tree.attrs:
        raise ValueError("the result does not name its strain energy: give it as energy=ph.Ogden()")
    return StrainEnergy.from_name(tree.attrs["strain_energy"])


def _common_geometry(tree: xr.DataTree) -> dict[str, float | None]:
    """Geometry that all tests of the result's data share; None where they differ."""
    default: dict[str, float | None] = dict.fromkeys(GEOMETRY)
    default |= {"axial_stretch": 1.0, "opening_angle": 0.0}
    if "constant_data" not in tree.children:
        return default
    data = inflation_data_of(tree)
    values = {name: np.unique(data[name].values) for name in default}
    return {name: float(value[0]) if value.size == 1 else None for name, value in values.items()}


@cache
def _response_function(energy: StrainEnergy) -> Any:
    """Compiled pressure and stiffness at radii (radius,), for parameters (chain, draw, 1)."""
    radius = pt.dvector("internal_radius")
    geometry = pt.dscalars("inner_radius", "outer_radius", "axial_stretch", "opening_angle")
    parameters = [
        pt.tensor(name, dtype="float64", shape=(None, None, 1)) for name in energy.parameter_names
    ]
    outputs = PressureIntegral(strain_energy=energy)(radius, *geometry, *parameters)
    return pytensor.function([radius, *geometry, *parameters], outputs)
