"""Compute posteriors of the Cauchy stresses through the wall."""

from typing import Any, Unpack

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.validation import Check
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.draws import (
    GivenTube,
    checked_numbers,
    checked_pressures,
    draws_of,
)
from pymc_hyperelastic.predictions.measured import warned


@one_thread
def wall_stress(
    tree: xr.DataTree,
    pressure: Any,
    *,
    points: Any = 21,
    pressure_unit: str = "kPa",
    check: Check = "warn",
    **tube: Unpack[GivenTube],
) -> xr.Dataset:
    r"""Compute the posterior of the Cauchy stresses through the wall at given pressures.

    At the circle of reference radius ``R``, with the current radius ``r(R)``,

    .. math::

        σ_{rr}(R) = -\int_R^B \frac{∂\hat W/∂λ_θ}{λ_z r} \, dR, \qquad
        σ_{θθ} = σ_{rr} + λ_θ \frac{∂\hat W}{∂λ_θ}, \qquad
        σ_{zz} = σ_{rr} + λ_z \frac{∂\hat W}{∂λ_z}.

    The radial stress is ``−p`` at the inner surface and 0 at the outer one. Hoop and axial stress
    jump between layers; at the interface the values of the inner layer are returned. The hoop
    stress balances the pressure, ``∫ σθθ dr = p a``, which is Laplace's law for its mean.

    Source: R. W. Ogden, Non-linear elastic deformations, Dover 1997, section 5.3.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    pressure : array_like, shape (pressure,)
        Internal pressures, in `pressure_unit`; the radius is that of :func:`radius_at_pressure`.
    points : int or array_like, default 21
        Number of circles at equal distances in the reference tube, or the positions
        ``(R − A)/(B − A)`` of the circles from 0 (inside) to 1 (outside).
    pressure_unit : str, default "kPa"
        Unit of the given pressures, as pint names it, such as ``"mmHg"``. The result is in kPa.
    check : {"warn", "raise", "ignore"}
        Action if a pressure is above 40 kPa (300 mmHg), which was probably meant in mmHg.
    **tube
        The material and the tube, see :func:`predict_pressure`.

    Returns
    -------
    xarray.Dataset
        ``sigma_rr``, ``sigma_tt`` and ``sigma_zz`` (kPa, tension positive) and the coordinate
        ``current_radius`` ``r(R)`` (mm), with dimensions (chain, draw, pressure, position), and the
        coordinate ``extrapolated`` (pressure), see :func:`radius_at_pressure`.

    Warns
    -----
    UserWarning
        If some draws do not reach a pressure; their stresses are NaN. If a pressure is
        extrapolated.

    Raises
    ------
    TypeError
        If `tree` is no DataTree or `energy` no strain energy.
    ValueError
        If a measure of the tube is unknown, no draw reaches any of the pressures, or a point is
        outside the wall.

    See Also
    --------
    plot_wall_stress

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, 30.0]])})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> tube = {"inner_radius": 7.0, "outer_radius": 9.0}
    >>> stress = ph.wall_stress(tree, 2.0, points=3, energy=ph.NeoHookean(), **tube)
    >>> stress["sigma_tt"].isel(draw=0).values.round(2).ravel()
    array([10.8 ,  9.23,  8.13])
    """
    draws = draws_of(tree, **tube)
    pressure = checked_pressures(pressure, pressure_unit, check)
    if isinstance(points, int) and not isinstance(points, bool) and points > 0:
        points = np.linspace(0.0, 1.0, points)
    position = checked_numbers("points", points, "a number of circles, or places from 0 to 1")
    if not np.all((position >= 0) & (position <= 1)):
        raise ValueError(f"points must be places in the wall, from 0 to 1; got {points!r}")
    radius = draws.radius_at(pressure)
    extrapolated = warned(draws.extrapolated_pressures(pressure, radius, pressure_unit))
    stresses = draws.tube.with_axis().stresses(radius[..., None], position)
    return draws.dataset(
        {"pressure": pressure, "position": position},
        extrapolated,
        sigma_rr=stresses.radial,
        sigma_tt=stresses.hoop,
        sigma_zz=stresses.axial,
        current_radius=stresses.current,
    ).set_coords("current_radius")
