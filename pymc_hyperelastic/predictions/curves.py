"""Curves of a tube as posteriors, from any sampled result: pressure, axial force and radius."""

from typing import Any, Unpack

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.validation import Check
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.draws import (
    Array,
    Draws,
    GivenTube,
    checked_pressures,
    checked_radii,
    draws_of,
)
from pymc_hyperelastic.predictions.measured import warn_user, warned

# What rounding leaves, mN.
NO_FORCE = 1e-9


@one_thread
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
        Current internal radii, in ``radius_unit``.
    **tube
        ``energy``, the strain energy, or the list of :class:`~pymc_hyperelastic.Layer` of the
        model, needed where the result does not name it; ``specimen``, of whom the prediction is,
        see below; ``inner_radius``, ``outer_radius`` (of the opened sector; not with layers),
        ``axial_stretch``, ``opening_angle`` (rad, the whole one that the sector lacks of a full
        circle), numbers, of the stretch also one for each of the radii (or for one radius several),
        as in an extension test; ``radius_unit`` (by default ``"mm"``), the unit of all
        radii that are given here, as pint knows it. The result is in mm. What is not given of the
        tube is that of each draw where the posterior has a variable of the name; for the outer
        radius also ``thickness`` (mm) or ``wall_area`` (mm², area of the unloaded wall's
        cross-section). Failing that it is that of the result's data, or of those of the
        ``specimen``, which must be the same for all these tests; without data the axial stretch
        is 1 and the opening angle 0.

    Returns
    -------
    xarray.Dataset
        ``pressure`` (kPa) and ``stiffness`` (kPa/mm) with dimensions (chain, draw, radius), and the
        coordinate ``extrapolated`` (radius): whether the wall is stretched there as none of the
        result's data was. Circles of the measured walls are points of hoop and axial stretch; what
        lies outside of their convex hull is extrapolated, also of a tube of other dimensions. Of
        the tube of the data that is what lies outside its measured radii. A result that does not
        hold its data, such as one read from an old file, cannot say, and the coordinate is absent.
        Where several axial stretches are given, ``axial_stretch`` (radius) is a coordinate, too.

    Warns
    -----
    UserWarning
        If something is extrapolated; it names what was asked for and what was measured.

    Raises
    ------
    TypeError
        If `tree` is no DataTree or `energy` no strain energy.
    ValueError
        If the strain energy, the specimen or the geometry is not known, or a parameter is not in
        the posterior, or a radius is impossible.

    See Also
    --------
    predict_axial_force, radius_at_pressure

    Notes
    -----
    Where specimens differ, in classes with ``variability="specimen"`` and in results of
    :func:`~pymc_hyperelastic.population_model`, a prediction is of the typical specimen, that at
    the ``location`` of the class, or with ``specimen="S1"`` of one that was measured, given its
    curves and its class. The attribute ``specimen`` of the result says of whom it is, and what was
    measured is that of this specimen alone. In a class, its draws are chosen among those that the
    class stores, each for one draw of the class's distribution by the density that this gives it.
    Where all specimens share their parameters, ``specimen`` states the tube and nothing else.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> tree = ph.open_result("sampled.nc")  # saved from the example of sample_smc
    >>> curve = ph.predict_pressure(tree, [8.0, 9.0])
    >>> curve["pressure"].dims
    ('chain', 'draw', 'radius')
    """
    draws = draws_of(tree, **tube)
    radius = draws.at_each_stretch(checked_radii(internal_radius, **tube))
    warned(draws.extrapolated_radii(radius))
    return pressure_curve(draws, radius)


def pressure_curve(draws: Draws, radius: Array) -> xr.Dataset:
    """Pressure and stiffness of draws at radii, see :func:`predict_pressure`, without a warning."""
    pressure, stiffness = draws.tube.pressure(radius)
    extrapolated = draws.extrapolated_radii(radius)
    return draws.dataset({"radius": radius}, extrapolated, pressure=pressure, stiffness=stiffness)


@one_thread
def predict_axial_force(
    tree: xr.DataTree,
    internal_radius: Any = None,
    *,
    pressure: Any = None,
    pressure_unit: str = "kPa",
    check: Check = "warn",
    **tube: Unpack[GivenTube],
) -> xr.Dataset:
    """Posterior of the tube's reduced axial force at new radii, without measurement error.

    It is what a force transducer at the end of the closed tube reads, see
    :func:`~pymc_hyperelastic.axial_force`. Arguments and errors are those of
    :func:`predict_pressure`; or in place of the radius a pressure is given, as where it is held
    while the tube is extended.

    Parameters
    ----------
    tree, internal_radius, **tube
        Those of :func:`predict_pressure`.
    pressure : array_like, shape (pressure,), optional
        Internal pressures, in `pressure_unit`, in place of radii: the force is that at the radius
        of :func:`radius_at_pressure`, draw by draw.
    pressure_unit, check
        Those of :func:`radius_at_pressure`.

    Returns
    -------
    xarray.Dataset
        ``axial_force`` (mN) with dimensions (chain, draw, radius); tension is positive. The
        coordinate ``extrapolated`` and its warning are those of :func:`predict_pressure`. Of given
        pressures the last dimension is ``pressure``, there is the ``radius`` (mm) as well, and the
        coordinate and warnings are those of :func:`radius_at_pressure`.

    Raises
    ------
    TypeError
        If radii and pressures are given, or neither.

    Warns
    -----
    UserWarning
        If something is extrapolated. If the force is 0 whatever the parameters, as that of
        :class:`~pymc_hyperelastic.CriscioneType`, and that of :class:`~pymc_hyperelastic.Ogden` at
        an axial stretch of 1.

    See Also
    --------
    predict_pressure, plot_axial_force

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[10.0, 20.0]])})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> tube = {"inner_radius": 1.0, "outer_radius": 1.5, "axial_stretch": 1.2}
    >>> force = ph.predict_axial_force(tree, 1.0, energy=ph.NeoHookean(), **tube)
    >>> force["axial_force"].values.round(3).ravel()
    array([19.641, 39.282])

    The tube is extended while the pressure is held:

    >>> tube["axial_stretch"] = [1.2, 1.4]
    >>> force = ph.predict_axial_force(tree, pressure=1.0, energy=ph.NeoHookean(), **tube)
    >>> force["axial_force"].isel(draw=0).values.round(3).ravel()
    array([19.448, 34.507])
    """
    if (internal_radius is None) == (pressure is None):
        raise TypeError("give internal_radius, or pressure, at which the force is asked for")
    draws = draws_of(tree, **tube)
    if pressure is not None:
        pressure = checked_pressures(pressure, pressure_unit, check)
        force = force_at_pressure(draws, draws.at_each_stretch(pressure), pressure_unit)
        if np.any(pressure > 0):
            warn_of_no_force(force["axial_force"])
        return force
    radius = draws.at_each_stretch(checked_radii(internal_radius, **tube))
    warned(draws.extrapolated_radii(radius))
    force = force_curve(draws, radius)
    # At rest a tube of any material has neither force nor pressure.
    if np.any(np.abs(draws.tube.pressure(radius)[0] * radius**2) > NO_FORCE):
        warn_of_no_force(force["axial_force"])
    return force


def force_curve(draws: Draws, radius: Array) -> xr.Dataset:
    """Axial force of draws at radii, see :func:`predict_axial_force`, without a warning."""
    extrapolated = draws.extrapolated_radii(radius)
    force = draws.tube.axial_force(radius)
    return draws.dataset({"radius": radius}, extrapolated, axial_force=force)


def warn_of_no_force(force: xr.DataArray) -> None:
    """Warn if axial forces of a tube that is inflated are 0, all of them."""
    if not np.any(np.abs(force) > NO_FORCE):
        warn_user(
            "the axial force is 0 at all of these radii, whatever the parameters: at this axial "
            "stretch the strain energy says nothing about a force that is measured"
        )


def force_at_pressure(draws: Draws, pressure: Array, unit: str) -> xr.Dataset:
    """Radius and axial force of draws at pressures, see :func:`predict_axial_force`."""
    radius = draws.radius_at(pressure)
    extrapolated = warned(draws.extrapolated_pressures(pressure, radius, unit))
    curves = {"radius": radius, "axial_force": draws.tube.axial_force(radius)}
    return draws.dataset({"pressure": pressure}, extrapolated, **curves)


@one_thread
def radius_at_pressure(
    tree: xr.DataTree,
    pressure: Any,
    *,
    pressure_unit: str = "kPa",
    check: Check = "warn",
    **tube: Unpack[GivenTube],
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
        Internal pressures, in `pressure_unit`; one for each axial stretch, or one for all, where
        several stretches are given.
    pressure_unit : str, default "kPa"
        Unit of what is given, as pint knows it, such as ``"mmHg"``. The result is in kPa.
    check : {"warn", "raise", "ignore"}
        What to do about pressures above 40 kPa (300 mmHg), which were probably given in mmHg.
    **tube
        The material and the tube, see :func:`predict_pressure`.

    Returns
    -------
    xarray.Dataset
        ``radius`` (mm) with dimensions (chain, draw, pressure), and the coordinate ``extrapolated``
        (pressure): whether none of the result's data on this tube has a pressure as low or as high,
        in inflation tests at this axial stretch, or in extension tests that pass through it.
        Pressures in other tubes, and at other axial stretches, do not compare: if the data have
        such, it is extrapolated where the wall at its median radius is, too, see
        :func:`predict_pressure`. Without data the coordinate is absent.

    Warns
    -----
    UserWarning
        If some draws do not reach a pressure; it says how many. If something is extrapolated; it
        names what was asked for and what was measured. If a pressure is above 40 kPa.

    Raises
    ------
    TypeError
        If `tree` is no DataTree or `energy` no strain energy.
    ValueError
        If something of the tube is not known, a pressure is no finite number, or no draw reaches
        any of the pressures.

    See Also
    --------
    predict_pressure, tube_properties

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
    pressure = checked_pressures(pressure, pressure_unit, check)
    pressure = draws.at_each_stretch(pressure)
    radius = draws.radius_at(pressure)
    extrapolated = warned(draws.extrapolated_pressures(pressure, radius, pressure_unit))
    return draws.dataset({"pressure": pressure}, extrapolated, radius=radius)
