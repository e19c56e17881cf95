"""Curves of a tube as posteriors, from any sampled result: pressure, axial force and radius."""

from typing import Any, Unpack

import xarray as xr

from pymc_hyperelastic.data.doubt import Check
from pymc_hyperelastic.predictions.draws import (
    GivenTube,
    checked_pressures,
    checked_radii,
    draws_of,
)


def predict_pressure(
    tree: xr.DataTree, internal_radius: Any, **tube: Unpack[GivenTube]
) -> xr.Dataset:
    """Posterior of the tube's pressure and stiffness at new radii, without measurement error.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model: of :func:`pymc_hyperelastic.sample_smc`, a class of
        :func:`pymc_hyperelastic.fit_classes`, or any result with a ``posterior`` group.
    internal_radius : array_like, shape (radius,)
        Current internal radii, mm.
    **tube
        ``energy``, the strain energy, needed where the result does not name it; ``inner_radius``,
        ``outer_radius`` (mm, of the opened sector), ``axial_stretch``, ``opening_angle`` (rad, the
        whole one that the sector lacks of a full circle), numbers. What is not given is that of
        each draw where the posterior has a variable of the name; for the outer radius also
        ``thickness`` (mm) or ``wall_area`` (mm², area of the unloaded wall's cross-section).
        Failing that it is that of the result's data, which must be the same for all its tests;
        without data the axial stretch is 1 and the opening angle 0.

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
    draws = draws_of(tree, **tube)
    radius = checked_radii(internal_radius)
    pressure, stiffness = draws.tube.pressure(radius)
    return draws.dataset({"radius": radius}, pressure=pressure, stiffness=stiffness)


def predict_axial_force(
    tree: xr.DataTree, internal_radius: Any, **tube: Unpack[GivenTube]
) -> xr.Dataset:
    """Posterior of the tube's reduced axial force at new radii, without measurement error.

    It is what a force transducer at the end of the closed tube reads, see
    :func:`~pymc_hyperelastic.axial_force`. Arguments and errors are those of
    :func:`predict_pressure`.

    Returns
    -------
    xarray.Dataset
        ``axial_force`` (mN) with dimensions (chain, draw, radius); tension is positive.

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[10.0, 20.0]])})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> tube = {"inner_radius": 1.0, "outer_radius": 1.5, "axial_stretch": 1.2}
    >>> force = ph.predict_axial_force(tree, 1.0, energy=ph.NeoHookean(), **tube)
    >>> force["axial_force"].values.round(3).ravel()
    array([19.641, 39.282])
    """
    draws = draws_of(tree, **tube)
    radius = checked_radii(internal_radius)
    return draws.dataset({"radius": radius}, axial_force=draws.tube.axial_force(radius))


def radius_at_pressure(
    tree: xr.DataTree, pressure: Any, *, check: Check = "warn", **tube: Unpack[GivenTube]
) -> xr.Dataset:
    r"""Posterior of the internal radius at which the tube carries given pressures.

    It is the inverse of :func:`predict_pressure`, ``p(a) = pressure``, draw by draw.

    The curve of a softening material has a maximum, and passes a pressure below it twice. The
    radius is the one on the branch that rises through the tube at rest: from
    :math:`a_0 = A/\sqrt{k λ_z}`, where all of the wall has the same hoop stretch (the unloaded
    radius of an isotropic tube without opening angle), the curve is followed while its slope is
    positive, between ``a₀/20`` and ``20 a₀``. Where that branch ends before the pressure is reached
    the radius is NaN.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    pressure : array_like, shape (pressure,)
        Internal pressures, kPa.
    check : {"warn", "raise", "ignore"}
        What to do about pressures above 40 kPa (300 mmHg), which were probably given in mmHg.
    **tube
        The material and the tube, see :func:`predict_pressure`.

    Returns
    -------
    xarray.Dataset
        ``radius`` (mm) with dimensions (chain, draw, pressure).

    Warns
    -----
    UserWarning
        If some draws do not reach a pressure; it says how many. If a pressure is above 40 kPa.

    Raises
    ------
    TypeError
        If `tree` is no DataTree or `energy` no strain energy.
    ValueError
        If something of the tube is not known, a pressure is no finite number, or no draw reaches
        any of the pressures.

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, 30.0]])})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> tube = {"inner_radius": 7.0, "outer_radius": 9.0}
    >>> a = ph.radius_at_pressure(tree, [0.0, 2.0], energy=ph.NeoHookean(), **tube)
    >>> a["radius"].values.round(4)
    array([[[7.    , 8.1932],
            [7.    , 7.7094]]])
    """
    draws = draws_of(tree, **tube)
    pressure = checked_pressures(pressure, check, stacklevel=2)
    return draws.dataset({"pressure": pressure}, radius=draws.radius_at(pressure))
