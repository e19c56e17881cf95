"""Check whether the draws of a posterior are physically admissible materials."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.reference_tube import Tube
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.mechanics.strain_energy.base import IsotropicStrainEnergy
from pymc_hyperelastic.models.forward import TubeNumbers
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.draws import Array, checked_radii, draws_of, radii_of_data
from pymc_hyperelastic.predictions.measured import warned
from pymc_hyperelastic.rounding import ROUNDING


@one_thread
def is_admissible(
    result: xr.DataTree,
    internal_radius: Any = None,
    *,
    tube: Tube | None = None,
    specimen: str | None = None,
    energy: StrainEnergy | Sequence[Layer] | None = None,
) -> xr.Dataset:
    r"""Check whether the draws of a posterior are admissible materials over a range of radii.

    Priors admit parameters for which the tube is unstable, or for which the larger stretch has the
    smaller stress. Two conditions are checked at each radius:

    ``pressure_rises`` : ``dp/da > 0``. If it fails, the inflated tube jumps to another radius.

    ``baker_ericksen`` : the larger principal stress has the direction of the larger stretch,

    .. math:: (σ_i - σ_j)(λ_i - λ_j) > 0 \quad \text{wherever } λ_i \neq λ_j,

    for each pair of the radial, hoop and axial direction, at eleven circles of every layer. The
    inequality holds for isotropic solids [1]_, and materials with fibres need not satisfy it. It is
    therefore checked only if all layers are isotropic.

    Parameters
    ----------
    result : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    internal_radius : array_like, shape (radius,), optional
        Current internal radii, mm; by default 50 equidistant radii over the range of the
        result's data.
    tube, specimen, energy
        See :func:`predict_pressure`.

    Returns
    -------
    xarray.Dataset
        The booleans ``pressure_rises`` and, for isotropic laws, ``baker_ericksen`` with dimensions
        (chain, draw). The attribute ``fraction`` of each is the fraction of draws that satisfy the
        condition, and the attribute ``summary`` of the Dataset states the fractions in words. If
        the result holds its data, the coordinates ``radius`` (mm) and ``extrapolated`` (radius)
        flag radii outside the measured range, see :func:`predict_pressure`.

    Warns
    -----
    UserWarning
        If some radii are outside the measured range.

    Raises
    ------
    TypeError
        If `result` is no DataTree, `tube` no Tube or `energy` no strain energy.
    ValueError
        If a measure of the tube is unknown, a radius is not positive, or neither radii nor data are
        given.

    See Also
    --------
    StrainEnergy

    References
    ----------
    .. [1] M. Baker, J. L. Ericksen, Inequalities restricting the form of the stress-deformation
       relations for isotropic elastic solids and Reiner-Rivlin fluids, Journal of the Washington
       Academy of Sciences 44 (1954) 33-35.

    Examples
    --------
    >>> import numpy as np, xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, -1.0]])})
    >>> result = xr.DataTree.from_dict({"posterior": posterior})
    >>> settings = {"tube": ph.Tube(7.0, 9.0), "energy": ph.NeoHookean()}
    >>> passed = ph.is_admissible(result, np.linspace(7, 10, 20), **settings)
    >>> passed["baker_ericksen"].values
    array([[ True, False]])
    >>> print(passed.attrs["summary"])
    From 7 to 10 mm, of 2 draws: pressure rises in 50.0 %, Baker-Ericksen holds in 50.0 %.
    """
    draws = draws_of(result, tube, specimen, energy)
    radius = draws.at_each_stretch(
        radii_of_data(draws.member.data)
        if internal_radius is None
        else checked_radii(internal_radius)
    )
    extrapolated = warned(draws.extrapolated_radii(radius))
    _, slope = draws.tube.pressure(radius)
    passed: dict[str, Any] = {"pressure_rises": ((slope > 0) & (slope < np.inf)).all(axis=-1)}
    if all(isinstance(layer.energy, IsotropicStrainEnergy) for layer in draws.tube.layers):
        passed["baker_ericksen"] = _baker_ericksen(draws.tube.with_axis(), radius[:, None])
    found = draws.dataset({}, **passed)
    words = {"pressure_rises": "pressure rises", "baker_ericksen": "Baker-Ericksen holds"}
    for name, values in passed.items():
        found[name].attrs = {"long_name": words[name], "fraction": float(values.mean())}
    shares = [f"{words[name]} in {100 * v.mean():.1f} %" for name, v in passed.items()]
    ends, count = f"{radius.min():g} to {radius.max():g} mm", slope[..., 0].size
    found.attrs["summary"] = f"From {ends}, of {count} draws: {', '.join(shares)}."
    if extrapolated is not None:
        at = draws.dataset({"radius": radius}, extrapolated)
        found = found.assign_coords(radius=at["radius"], extrapolated=at["extrapolated"])
    return found


def _baker_ericksen(tube: TubeNumbers, radius: Array) -> Array:
    """Return True for each draw in which all layers satisfy the Baker-Ericksen inequalities."""
    passed: Any = True
    for layer in tube.layers:
        thickness = layer.outer_radius - layer.inner_radius
        reference = layer.inner_radius + np.linspace(0.0, 1.0, 11) * thickness
        circles = tube.circles(layer, radius, reference)
        log_radial = -circles.log_hoop - circles.log_axial
        # Differences from the radial stress. NaN, after an overflow, fails the inequality.
        stress = (np.zeros_like(log_radial), circles.hoop_difference, circles.axial_difference)
        stretch = (log_radial, circles.log_hoop, circles.log_axial)
        with np.errstate(invalid="ignore"):
            # Rounding errors could reverse the order of equal stretches.
            holds = [
                (np.abs(stretch[i] - stretch[j]) < ROUNDING)
                | ((stress[i] - stress[j]) * (stretch[i] - stretch[j]) > 0)
                for i, j in ((0, 1), (1, 2), (2, 0))
            ]
        passed = passed & np.all(holds, axis=(0, -2, -1))
    return passed
