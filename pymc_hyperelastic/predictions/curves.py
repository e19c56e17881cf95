"""Predict pressure, axial force and radius of a tube, as posteriors, from any sampled result."""

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

# Force below which a force counts as zero up to rounding errors, mN.
NO_FORCE = 1e-9


@one_thread
def predict_pressure(
    tree: xr.DataTree, internal_radius: Any, **tube: Unpack[GivenTube]
) -> xr.Dataset:
    """Predict the tube's pressure and stiffness at new radii, without measurement error.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model: of :func:`pymc_hyperelastic.sample_smc`, a class of
        :func:`pymc_hyperelastic.fit_classes`, or any result with a ``posterior`` group.
    internal_radius : array_like, shape (radius,)
        Current internal radii, in ``radius_unit``.
    **tube
        Options that override the material or the tube of the result:

        ``energy`` : strain energy, or list of :class:`~pymc_hyperelastic.Layer`, of the model;
        required if the result does not name it.

        ``specimen`` : name of the specimen to predict, see Notes.

        ``inner_radius``, ``outer_radius`` : radii of the reference tube (the opened sector), in
        ``radius_unit``. With layers the outer radius follows from their thicknesses, and cannot be
        given.

        ``axial_stretch`` : one number, or one for each radius, as in an extension test; several
        stretches may share a single radius.

        ``opening_angle`` : whole angle by which the sector falls short of a full circle, rad.

        ``radius_unit`` : unit of all given radii, as pint names it; ``"mm"`` by default. The result
        is in mm.

        A measure that is not given is taken from the posterior, draw by draw, if this has a
        variable of that name; the outer radius may also follow from ``thickness`` (mm) or
        ``wall_area`` (mm², cross-section of the unloaded wall). Otherwise it is taken from the
        result's data, or from the tests of the ``specimen``, all of which must agree. Without data
        the axial stretch is 1 and the opening angle 0.

    Returns
    -------
    xarray.Dataset
        ``pressure`` (kPa) and ``stiffness`` (kPa/mm) with dimensions (chain, draw, radius), and the
        coordinate ``extrapolated`` (radius). It is True if the hoop and axial stretches of the wall
        lie outside the convex hull of the stretches in the result's data; for the tube of the data
        this means outside its measured radii. The coordinate is absent if the result does not hold
        its data. If several axial stretches are given, ``axial_stretch`` (radius) is also a
        coordinate.

    Warns
    -----
    UserWarning
        If a radius is extrapolated; the message states the requested and the measured range.

    Raises
    ------
    TypeError
        If `tree` is no DataTree or `energy` no strain energy.
    ValueError
        If the strain energy, the specimen or the geometry is unknown, a parameter is missing from
        the posterior, or a radius is not positive.

    See Also
    --------
    predict_axial_force, radius_at_pressure

    Notes
    -----
    Specimens differ in classes with ``variability="specimen"`` and in results of
    :func:`~pymc_hyperelastic.population_model`. Predictions are then for the typical specimen, at
    the ``location`` of the class, or for a measured one, ``specimen="S1"``, given its curves and
    its class. For a measured specimen only its own tests define the measured range. The attribute
    ``specimen`` of the result is its name. A class stores draws of each specimen; for each draw of
    the class's distribution, one of them is resampled in proportion to its importance weight times
    its density under this distribution. If all specimens share their parameters, ``specimen``
    selects the tube only.

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
    """Return what :func:`predict_pressure` returns, for radii in mm, without a warning."""
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
    """Predict the tube's reduced axial force at new radii, without measurement error.

    A force transducer at the end of the closed tube reads this force, see
    :func:`~pymc_hyperelastic.axial_force`. Give either radii or pressures, the latter for example
    if the tube is extended at a held pressure. See :func:`predict_pressure` for further errors.

    Parameters
    ----------
    tree, internal_radius, **tube
        See :func:`predict_pressure`.
    pressure : array_like, shape (pressure,), optional
        Internal pressures, in `pressure_unit`, instead of radii. The force is computed at the
        radius of :func:`radius_at_pressure`, draw by draw.
    pressure_unit, check
        See :func:`radius_at_pressure`.

    Returns
    -------
    xarray.Dataset
        ``axial_force`` (mN) with dimensions (chain, draw, radius); tension is positive. The
        coordinate ``extrapolated`` and its warning are described in :func:`predict_pressure`. If
        pressures are given, the last dimension is ``pressure``, the Dataset also has the ``radius``
        (mm), and coordinate and warnings are described in :func:`radius_at_pressure`.

    Raises
    ------
    TypeError
        If both radii and pressures are given, or neither.

    Warns
    -----
    UserWarning
        If a point is extrapolated. If the force is 0 for all parameters, as for
        :class:`~pymc_hyperelastic.CriscioneType`, or for :class:`~pymc_hyperelastic.Ogden` at an
        axial stretch of 1.

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

    Extend the tube at a held pressure:

    >>> tube["axial_stretch"] = [1.2, 1.4]
    >>> force = ph.predict_axial_force(tree, pressure=1.0, energy=ph.NeoHookean(), **tube)
    >>> force["axial_force"].isel(draw=0).values.round(3).ravel()
    array([19.448, 34.507])
    """
    if (internal_radius is None) == (pressure is None):
        raise TypeError("give internal_radius, or pressure, and not both")
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
    # Do not warn about a tube at rest, where pressure and force are 0 for every material.
    if np.any(np.abs(draws.tube.pressure(radius)[0] * radius**2) > NO_FORCE):
        warn_of_no_force(force["axial_force"])
    return force


def force_curve(draws: Draws, radius: Array) -> xr.Dataset:
    """Return what :func:`predict_axial_force` returns, for radii in mm, without a warning."""
    extrapolated = draws.extrapolated_radii(radius)
    force = draws.tube.axial_force(radius)
    return draws.dataset({"radius": radius}, extrapolated, axial_force=force)


def warn_of_no_force(force: xr.DataArray) -> None:
    """Warn if all axial forces of an inflated tube are 0."""
    if not np.any(np.abs(force) > NO_FORCE):
        warn_user(
            "the axial force is 0 at all of these radii, whatever the parameters: at this axial "
            "stretch the strain energy cannot describe a measured force"
        )


def force_at_pressure(draws: Draws, pressure: Array, unit: str) -> xr.Dataset:
    """Return radius and axial force at pressures in kPa, see :func:`predict_axial_force`."""
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
    r"""Compute the posterior of the internal radius of the tube at given pressures.

    It is the inverse of :func:`predict_pressure`, ``p(a) = pressure``, draw by draw.

    The curve of a softening material has a maximum, and reaches each lower pressure twice. This
    function returns the radius on the rising branch that contains the tube at rest. The branch
    starts at :math:`a_0 = A/\sqrt{k λ_z}`, where the hoop stretch is uniform in the wall (the
    unloaded radius of an isotropic tube without opening angle), and is followed in both directions
    while the slope is positive, between ``a₀/20`` and ``20 a₀``. If the branch does not reach the
    pressure, the radius is NaN.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    pressure : array_like, shape (pressure,)
        Internal pressures, in `pressure_unit`. If several axial stretches are given, one pressure
        for each, or one for all.
    pressure_unit : str, default "kPa"
        Unit of the given pressures, as pint names it, such as ``"mmHg"``. The result is in kPa.
    check : {"warn", "raise", "ignore"}
        Action if a pressure is above 40 kPa (300 mmHg), which was probably meant in mmHg.
    **tube
        The material and the tube, see :func:`predict_pressure`.

    Returns
    -------
    xarray.Dataset
        ``radius`` (mm) with dimensions (chain, draw, pressure), and the coordinate ``extrapolated``
        (pressure). It is True if the pressure is outside the range of the result's data on this
        tube, in inflation tests at this axial stretch or extension tests that pass through it.
        Pressures of other tubes, and at other axial stretches, cannot be compared. If the data have
        such tests, a pressure is extrapolated only if its median radius is extrapolated as well,
        see :func:`predict_pressure`. Without data the coordinate is absent.

    Warns
    -----
    UserWarning
        If some draws do not reach a pressure; the message states how many. If a pressure is
        extrapolated; the message states the requested and the measured range. If a pressure is
        above 40 kPa.

    Raises
    ------
    TypeError
        If `tree` is no DataTree or `energy` no strain energy.
    ValueError
        If a measure of the tube is unknown, a pressure is not finite, or no draw reaches any of the
        pressures.

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
