"""Compute posteriors of the Cauchy stresses through the wall."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.validation import Check
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.conditions import Conditions, as_conditions
from pymc_hyperelastic.predictions.curves import inflated
from pymc_hyperelastic.predictions.draws import checked_numbers, draws_of


@one_thread
def wall_stress(
    result: xr.DataTree,
    at: Conditions | Any,
    points: Any = 21,
    *,
    specimen: str | None = None,
    energy: StrainEnergy | Sequence[Layer] | None = None,
    check: Check = "warn",
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
    result : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    at : Conditions, or array_like of pressures in kPa, shape (pressure,)
        The pressures and the tube; the radius is that of :func:`radius_at_pressure`.
    points : int or array_like, default 21
        Number of circles at equal distances in the reference tube, or the positions
        ``(R − A)/(B − A)`` of the circles from 0 (inside) to 1 (outside).
    specimen, energy
        See :func:`predict_pressure`.
    check : {"warn", "raise", "ignore"}
        Action if a pressure is above 40 kPa (300 mmHg), which was probably meant in mmHg.

    Returns
    -------
    xarray.Dataset
        ``sigma_rr``, ``sigma_tt`` and ``sigma_zz`` (kPa, tension positive) and the coordinate
        ``current_radius`` ``r(R)`` (mm), with dimensions (chain, draw, pressure, position), and the
        coordinates ``pressure`` and ``extrapolated``, see :func:`radius_at_pressure`.

    Warns
    -----
    UserWarning
        If some draws do not reach a pressure; their stresses are NaN. If a pressure is
        extrapolated.

    Raises
    ------
    TypeError
        If `result` is no DataTree or `energy` no strain energy.
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
    >>> result = xr.DataTree.from_dict({"posterior": posterior})
    >>> at = ph.Conditions(2.0, tube=ph.Tube(7.0, 9.0))
    >>> stress = ph.wall_stress(result, at, points=3, energy=ph.NeoHookean())
    >>> stress["sigma_tt"].isel(draw=0).values.round(2).ravel()
    array([10.8 ,  9.23,  8.13])
    """
    at = as_conditions(at)
    draws = draws_of(result, at.tube, specimen, energy)
    if isinstance(points, int) and not isinstance(points, bool) and points > 0:
        points = np.linspace(0.0, 1.0, points)
    position = checked_numbers("points", points, "a number of circles, or places from 0 to 1")
    if not np.all((position >= 0) & (position <= 1)):
        raise ValueError(f"points must be places in the wall, from 0 to 1; got {points!r}")
    pressure, radius, extrapolated = inflated(draws, at, check)
    stresses = draws.tube.with_axis().stresses(radius[..., None], position)
    found = draws.dataset(
        {"pressure": pressure, "position": position},
        extrapolated,
        sigma_rr=stresses.radial,
        sigma_tt=stresses.hoop,
        sigma_zz=stresses.axial,
        current_radius=stresses.current,
    )
    return at.label_pressures(found.set_coords("current_radius"))
