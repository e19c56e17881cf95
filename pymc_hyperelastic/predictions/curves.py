"""Predict pressure, axial force and radius of a tube, as posteriors, from any sampled result."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.validation import Check
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.reference_tube import Tube
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.conditions import Conditions, as_conditions
from pymc_hyperelastic.predictions.draws import Array, Draws, checked_radii, draws_of
from pymc_hyperelastic.predictions.measured import Extrapolated, warn_user, warned
from pymc_hyperelastic.rounding import ROUNDING


@one_thread
def predict_pressure(
    result: xr.DataTree,
    internal_radius: Any,
    *,
    tube: Tube | None = None,
    specimen: str | None = None,
    energy: StrainEnergy | Sequence[Layer] | None = None,
) -> xr.Dataset:
    """Predict the tube's pressure and stiffness at new radii, without measurement error.

    Parameters
    ----------
    result : xarray.DataTree
        A sampled model: of :func:`pymc_hyperelastic.sample_smc`, a class of
        :func:`pymc_hyperelastic.fit_classes`, or any result with a ``posterior`` group.
    internal_radius : array_like, shape (radius,)
        Current internal radii, mm.
    tube : Tube, optional
        Measures of the reference tube that replace those of the result. Radii are those of the
        opened sector unless ``radii_of="ring"``; those of a ring, and a wall that is stated by its
        area, need the opening angle. With layers the outer radius follows from their
        thicknesses, and cannot be stated. The axial stretch is one number, or one for each radius,
        as in an extension test; several stretches may share a single radius.

        A measure that is not stated is taken from the posterior, draw by draw, if this has a
        variable of that name; the outer radius may also follow from ``thickness`` (mm) or
        ``wall_area`` (mm², cross-section of the unloaded wall). Otherwise it is taken from the
        result's data, or from the tests of the `specimen`, all of which must agree. Without data
        the axial stretch is 1 and the opening angle 0.
    specimen : str, optional
        Name of the specimen to predict, see Notes.
    energy : StrainEnergy or list of Layer, optional
        The strain energy, or the layers, of the model; required if the result does not name it.

    Returns
    -------
    xarray.Dataset
        ``pressure`` (kPa) and ``stiffness`` (kPa/mm) with dimensions (chain, draw, radius), and the
        coordinate ``extrapolated`` (radius). It is True if the hoop and axial stretches of the wall
        lie outside the convex hull of the stretches in the result's data; for the tube of the data
        this means outside its measured radii. The coordinate is absent if the result does not hold
        its data. If several axial stretches are stated, ``axial_stretch`` (radius) is also a
        coordinate.

    Warns
    -----
    UserWarning
        If a radius is extrapolated; the message states the requested and the measured range.

    Raises
    ------
    TypeError
        If `result` is no DataTree, `tube` no Tube or `energy` no strain energy.
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
    draws = draws_of(result, tube, specimen, energy)
    radius = draws.at_each_stretch(checked_radii(internal_radius))
    extrapolated = warned(draws.extrapolated_radii(radius))
    pressure, stiffness = draws.tube.pressure(radius)
    return draws.dataset({"radius": radius}, extrapolated, pressure=pressure, stiffness=stiffness)


@one_thread
def predict_axial_force(
    result: xr.DataTree,
    internal_radius: Any,
    *,
    tube: Tube | None = None,
    specimen: str | None = None,
    energy: StrainEnergy | Sequence[Layer] | None = None,
) -> xr.Dataset:
    """Predict the tube's reduced axial force at new radii, without measurement error.

    A force transducer at the end of the closed tube reads this force, see
    :func:`~pymc_hyperelastic.axial_force`. The force at given pressures is a quantity of
    :func:`tube_properties`.

    Parameters
    ----------
    result, internal_radius, tube, specimen, energy
        See :func:`predict_pressure`.

    Returns
    -------
    xarray.Dataset
        ``axial_force`` (mN) with dimensions (chain, draw, radius); tension is positive. The
        coordinate ``extrapolated`` is described in :func:`predict_pressure`.

    Raises
    ------
    TypeError, ValueError
        See :func:`predict_pressure`.

    Warns
    -----
    UserWarning
        If a radius is extrapolated. If the force is 0 for all parameters, as for
        :class:`~pymc_hyperelastic.CriscioneType`, or for :class:`~pymc_hyperelastic.Ogden` at an
        axial stretch of 1.

    See Also
    --------
    predict_pressure, tube_properties, plot_fit

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[10.0, 20.0]])})
    >>> result = xr.DataTree.from_dict({"posterior": posterior})
    >>> tube = ph.Tube(1.0, 1.5, axial_stretch=1.2)
    >>> force = ph.predict_axial_force(result, 1.0, tube=tube, energy=ph.NeoHookean())
    >>> force["axial_force"].values.round(3).ravel()
    array([19.641, 39.282])

    Extend the tube at a held pressure:

    >>> at = ph.Conditions(1.0, tube=ph.Tube(1.0, 1.5, axial_stretch=[1.2, 1.4]))
    >>> properties = ph.tube_properties(result, at, energy=ph.NeoHookean())
    >>> properties["axial_force"].isel(draw=0).values.round(3).ravel()
    array([19.448, 34.507])
    """
    draws = draws_of(result, tube, specimen, energy)
    radius = draws.at_each_stretch(checked_radii(internal_radius))
    extrapolated = warned(draws.extrapolated_radii(radius))
    force = draws.tube.axial_force(radius)
    # Do not warn about a tube at rest, where pressure and force are 0 for every material.
    if np.any(np.abs(draws.tube.pressure(radius)[0] * radius**2) > ROUNDING):
        warn_of_no_force(force)
    return draws.dataset({"radius": radius}, extrapolated, axial_force=force)


def warn_of_no_force(force: Any) -> None:
    """Warn if all axial forces of an inflated tube are 0."""
    if not np.any(np.abs(force) > ROUNDING):
        warn_user(
            "the axial force is 0 at all of these radii, whatever the parameters: at this axial "
            "stretch the strain energy cannot describe a measured force"
        )


@one_thread
def radius_at_pressure(
    result: xr.DataTree,
    at: Conditions | Any,
    *,
    specimen: str | None = None,
    energy: StrainEnergy | Sequence[Layer] | None = None,
    check: Check = "warn",
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
    result : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    at : Conditions, or array_like of pressures in kPa, shape (pressure,)
        The pressures and the tube. If the tube has several axial stretches, there is one pressure
        for each of them, or one for all.
    specimen, energy
        See :func:`predict_pressure`.
    check : {"warn", "raise", "ignore"}
        Action if a pressure is above 40 kPa (300 mmHg), which was probably meant in mmHg.

    Returns
    -------
    xarray.Dataset
        ``radius`` (mm) with dimensions (chain, draw, pressure), and the coordinates ``pressure``,
        in the unit of `at`, and ``extrapolated`` (pressure). The latter is True if the pressure is
        outside the range of the result's data on this tube, in inflation tests at this axial
        stretch or extension tests that pass through it. Pressures of other tubes, and at other
        axial stretches, cannot be compared. If the data have such tests, a pressure is extrapolated
        only if its median radius is extrapolated as well, see :func:`predict_pressure`. Without
        data the coordinate is absent.

    Warns
    -----
    UserWarning
        If some draws do not reach a pressure; the message states how many. If a pressure is
        extrapolated; the message states the requested and the measured range. If a pressure is
        above 40 kPa.

    Raises
    ------
    TypeError
        If `result` is no DataTree or `energy` no strain energy.
    ValueError
        If a measure of the tube is unknown, no pressure is given, or no draw reaches any of the
        pressures.

    See Also
    --------
    predict_pressure, tube_properties, Conditions

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, 30.0]])})
    >>> result = xr.DataTree.from_dict({"posterior": posterior})
    >>> at = ph.Conditions([0.0, 2.0], tube=ph.Tube(7.0, 9.0))
    >>> a = ph.radius_at_pressure(result, at, energy=ph.NeoHookean())
    >>> a["radius"].values.round(4)
    array([[[7.    , 8.1932],
            [7.    , 7.7094]]])
    """
    at = as_conditions(at)
    draws = draws_of(result, at.tube, specimen, energy)
    pressure, radius, extrapolated = inflated(draws, at, check)
    found = draws.dataset({"pressure": pressure}, extrapolated, radius=radius)
    return at.label_pressures(found)


def inflated(
    draws: Draws, at: Conditions, check: Check
) -> tuple[Array, Array, Extrapolated | None]:
    """Return pressures (kPa), radii (mm) at them, and flags; warn of extrapolated pressures."""
    pressure = draws.at_each_stretch(at.in_kilopascal(check))
    radius = draws.radius_at(pressure)
    return (
        pressure,
        radius,
        warned(draws.extrapolated_pressures(pressure, radius, at.pressure_unit)),
    )
