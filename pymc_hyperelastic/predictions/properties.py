"""What laboratories report of a tube, as posteriors: elastic properties, stresses, stability."""

from numbers import Real
from typing import Any, Unpack

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.doubt import Check
from pymc_hyperelastic.mechanics.strain_energy.isotropic import _Isotropic
from pymc_hyperelastic.models.forward import TubeNumbers
from pymc_hyperelastic.predictions.draws import (
    Array,
    GivenTube,
    checked_numbers,
    checked_pressures,
    checked_radii,
    draws_of,
    radii_of_data,
)
from pymc_hyperelastic.predictions.measured import warned

# Circles of the wall at which admissibility is looked at.
_CIRCLES = 11
# Stretches whose logarithms differ by less have no order that rounding leaves intact.
_SAME_STRETCH = 1e-6


def tube_properties(
    tree: xr.DataTree,
    pressure: Any,
    *,
    density: float = 1060.0,
    pressure_unit: str = "kPa",
    check: Check = "warn",
    **tube: Unpack[GivenTube],
) -> xr.Dataset:
    r"""Posterior of the elastic properties that are reported of a vessel, at given pressures.

    They follow from the curve ``p(a)`` and its slope at constant axial stretch, at the radius of
    :func:`radius_at_pressure`, which also says what is warned of, and what is an error.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    pressure : array_like, shape (pressure,)
        Internal pressures, in `pressure_unit`.
    density : float, default 1060
        Density ``ρ`` of the fluid within, kg/m³; that of blood by default.
    pressure_unit : str, default "kPa"
        Unit of what is given, as pint knows it, such as ``"mmHg"``. The result is in kPa.
    check : {"warn", "raise", "ignore"}
        What to do about pressures above 40 kPa (300 mmHg), which were probably given in mmHg.
    **tube
        The material and the tube, see :func:`predict_pressure`.

    Returns
    -------
    xarray.Dataset
        With dimensions (chain, draw, pressure), and ``A = π a²`` the area of the lumen:

        ``radius`` : internal radius ``a``, mm.

        ``outer_radius`` : current outer radius ``b``, mm, ``b² = a² + (B² − A₀²)/(k λz)`` from the
        reference radii ``A₀ < B``.

        ``stiffness`` : ``dp/da``, kPa/mm.

        ``compliance`` : ``dA/dp = 2π a/(dp/da)``, mm²/kPa [1]_.

        ``distensibility`` : ``(dA/dp)/A = 2/(a dp/da)``, 1/kPa [1]_.

        ``peterson_modulus`` : pressure-strain modulus ``dp/(dd/d) = a dp/da`` of the internal
        diameter ``d``, kPa [2]_.

        ``incremental_modulus`` : ``2 (1 − ν²) a² b/(b² − a²) · dp/db`` with ``ν = ½`` and, as the
        wall keeps its volume, ``dp/db = (b/a) dp/da``, kPa. It is Young's modulus of the linear
        isotropic tube that has the same slope [3]_.

        ``pulse_wave_velocity`` : ``√(A/(ρ dA/dp))``, m/s [4]_.

        The coordinate ``extrapolated`` (pressure) is that of :func:`radius_at_pressure`.

    Warns
    -----
    UserWarning
        If some draws do not reach a pressure, or something is extrapolated.

    Raises
    ------
    ValueError
        If the density is not positive.

    References
    ----------
    .. [1] M. F. O'Rourke, J. A. Staessen, C. Vlachopoulos, D. Duprez, G. E. Plante, Clinical
       applications of arterial stiffness; definitions and reference values, American Journal of
       Hypertension 15 (2002) 426-444.
    .. [2] L. H. Peterson, R. E. Jensen, J. Parnell, Mechanical properties of arteries in vivo,
       Circulation Research 8 (1960) 622-639.
    .. [3] D. H. Bergel, The static elastic properties of the arterial wall, Journal of Physiology
       156 (1961) 445-457.
    .. [4] J. C. Bramwell, A. V. Hill, The velocity of the pulse wave in man, Proceedings of the
       Royal Society B 93 (1922) 298-306.

    Examples
    --------
    At rest the incremental modulus of an isotropic tube is Young's, three times the shear modulus:

    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, 30.0]])})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> tube = {"inner_radius": 7.0, "outer_radius": 9.0}
    >>> properties = ph.tube_properties(tree, 0.0, energy=ph.NeoHookean(), **tube)
    >>> properties["incremental_modulus"].values.round(6).ravel()
    array([60., 90.])
    >>> properties["pulse_wave_velocity"].values.round(3).ravel()
    array([2.73 , 3.344])
    """
    if not (isinstance(density, Real) and 0 < density < np.inf):
        raise ValueError(f"density must be a positive number in kg/m³; got {density!r}")
    draws = draws_of(tree, **tube)
    pressure = checked_pressures(pressure, pressure_unit, check, stacklevel=2)
    a = draws.radius_at(pressure)
    extrapolated = warned(draws.extrapolated_pressures(pressure, a, pressure_unit))
    _, slope = draws.tube.pressure(a)
    b = draws.tube.current(draws.tube.geometry["outer_radius"], a)
    per_area = 2 / (a * slope)
    return draws.dataset(
        {"pressure": pressure},
        extrapolated,
        radius=a,
        outer_radius=b,
        stiffness=slope,
        compliance=np.pi * a**2 * per_area,
        distensibility=per_area,
        peterson_modulus=a * slope,
        incremental_modulus=1.5 * a**2 * b / ((b - a) * (b + a)) * (b / a * slope),
        # 1000 Pa in a kPa: then the velocity is in m/s.
        pulse_wave_velocity=np.sqrt(1000 / (density * per_area)),
    )


def pulse_wave_velocity(
    tree: xr.DataTree,
    pressure: Any,
    *,
    density: float = 1060.0,
    pressure_unit: str = "kPa",
    check: Check = "warn",
    **tube: Unpack[GivenTube],
) -> xr.Dataset:
    r"""Posterior of the speed at which a pulse travels along the tube, at given pressures.

    .. math:: c = \sqrt{\frac{A}{ρ \, dA/dp}} = \sqrt{\frac{a}{2ρ} \frac{dp}{da}}

    It is the quantity for whose sake a likelihood weighs the slope of a curve. Source: Bramwell and
    Hill, see :func:`tube_properties`, which gives it together with others.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    pressure : array_like, shape (pressure,)
        Internal pressures, in `pressure_unit`.
    density : float, default 1060
        Density ``ρ`` of the fluid within, kg/m³; that of blood by default.
    pressure_unit : str, default "kPa"
        Unit of what is given, as pint knows it, such as ``"mmHg"``. The result is in kPa.
    check : {"warn", "raise", "ignore"}
        What to do about pressures above 40 kPa (300 mmHg), which were probably given in mmHg.
    **tube
        The material and the tube, see :func:`predict_pressure`.

    Returns
    -------
    xarray.Dataset
        ``pulse_wave_velocity`` in m/s, with dimensions (chain, draw, pressure), and the coordinate
        ``extrapolated`` (pressure) of :func:`radius_at_pressure`.

    Warns
    -----
    UserWarning
        If some draws do not reach a pressure, or something is extrapolated.

    Raises
    ------
    ValueError
        If the density is not positive, or no draw reaches a pressure.

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, 30.0]])})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> tube = {"inner_radius": 7.0, "outer_radius": 9.0}
    >>> speed = ph.pulse_wave_velocity(tree, 0.0, energy=ph.NeoHookean(), **tube)
    >>> speed["pulse_wave_velocity"].values.round(3).ravel()
    array([2.73 , 3.344])
    """
    checked_pressures(pressure, pressure_unit, check, stacklevel=2)
    settings: dict[str, Any] = {"density": density, "pressure_unit": pressure_unit}
    settings["check"] = "ignore"
    return tube_properties(tree, pressure, **settings, **tube)[["pulse_wave_velocity"]]


def wall_stress(
    tree: xr.DataTree,
    pressure: Any,
    *,
    points: Any = 21,
    pressure_unit: str = "kPa",
    check: Check = "warn",
    **tube: Unpack[GivenTube],
) -> xr.Dataset:
    r"""Posterior of the Cauchy stresses through the wall at given pressures.

    At the circle of reference radius ``R``, which moves to ``r(R)``,

    .. math::

        σ_{rr}(R) = -\int_R^B \frac{∂\hat W/∂λ_θ}{λ_z r} \, dR, \qquad
        σ_{θθ} = σ_{rr} + λ_θ \frac{∂\hat W}{∂λ_θ}, \qquad
        σ_{zz} = σ_{rr} + λ_z \frac{∂\hat W}{∂λ_z}.

    The radial stress is ``−p`` inside and 0 outside. Between layers hoop and axial stress jump; at
    the interface itself they are those of the layer within. The hoop stress balances the pressure,
    ``∫ σθθ dr = p a``: Laplace's law for its mean over the thickness.

    Source: R. W. Ogden, Non-linear elastic deformations, Dover 1997, section 5.3.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    pressure : array_like, shape (pressure,)
        Internal pressures, in `pressure_unit`; the radius is that of :func:`radius_at_pressure`.
    points : int or array_like, default 21
        Where in the wall: a number of circles at equal distances in the reference tube, or their
        places ``(R − A)/(B − A)`` from 0 (inside) to 1 (outside).
    pressure_unit : str, default "kPa"
        Unit of what is given, as pint knows it, such as ``"mmHg"``. The result is in kPa.
    check : {"warn", "raise", "ignore"}
        What to do about pressures above 40 kPa (300 mmHg), which were probably given in mmHg.
    **tube
        The material and the tube, see :func:`predict_pressure`.

    Returns
    -------
    xarray.Dataset
        ``sigma_rr``, ``sigma_tt`` and ``sigma_zz`` (kPa) with dimensions (chain, draw, pressure,
        position), tension positive, the coordinate ``current_radius`` (mm), ``r(R)``, likewise, and
        the coordinate ``extrapolated`` (pressure) of :func:`radius_at_pressure`.

    Warns
    -----
    UserWarning
        If some draws do not reach a pressure; the stresses are NaN there. If something is
        extrapolated.

    Raises
    ------
    TypeError
        If `tree` is no DataTree or `energy` no strain energy.
    ValueError
        If something of the tube is not known, no draw reaches any of the pressures, or a point is
        outside the wall.

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
    pressure = checked_pressures(pressure, pressure_unit, check, stacklevel=2)
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


def admissible(
    tree: xr.DataTree, internal_radius: Any = None, **tube: Unpack[GivenTube]
) -> xr.Dataset:
    r"""Which draws of a posterior are materials that behave as solids do, over a range of radii.

    Priors admit parameters whose tube would lose its stability, or whose stresses point the wrong
    way. Two conditions are looked at, at each of the radii:

    ``pressure_rises`` : ``dp/da > 0``; else the tube jumps to another radius when it is inflated.

    ``baker_ericksen`` : the greater principal stress is in the direction of the greater stretch,

    .. math:: (σ_i - σ_j)(λ_i - λ_j) > 0 \quad \text{wherever } λ_i \neq λ_j,

    for each two of the radial, hoop and axial direction, at eleven circles of every layer. It is
    stated for isotropic solids [1]_, and fibres need not obey it: it is reported for the isotropic
    laws of the package only.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    internal_radius : array_like, shape (radius,), optional
        Current internal radii, in ``radius_unit``; by default 40 between the ends of the result's
        data.
    **tube
        The material and the tube, see :func:`predict_pressure`.

    Returns
    -------
    xarray.Dataset
        The booleans ``pressure_rises`` and, for isotropic laws, ``baker_ericksen`` with dimensions
        (chain, draw). The attribute ``fraction`` of each is that of the draws that pass, and
        ``summary`` of the Dataset says it in words. If the result holds its data, the coordinates
        ``radius`` and ``extrapolated`` (radius) tell where it was looked at beyond what was
        measured, see :func:`predict_pressure`.

    Warns
    -----
    UserWarning
        If some radii are beyond what was measured.

    Raises
    ------
    TypeError
        If `tree` is no DataTree or `energy` no strain energy.
    ValueError
        If something of the tube is not known, a radius is impossible, or there are neither radii
        nor data.

    References
    ----------
    .. [1] M. Baker, J. L. Ericksen, Inequalities restricting the form of the stress-deformation
       relations for isotropic elastic solids and Reiner-Rivlin fluids, Journal of the Washington
       Academy of Sciences 44 (1954) 33-35.

    Examples
    --------
    >>> import numpy as np, xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, -1.0]])})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> tube = {"inner_radius": 7.0, "outer_radius": 9.0}
    >>> passed = ph.admissible(tree, np.linspace(7, 10, 20), energy=ph.NeoHookean(), **tube)
    >>> passed["baker_ericksen"].values
    array([[ True, False]])
    >>> print(passed.attrs["summary"])
    From 7 to 10 mm, of 2 draws: pressure rises in 50.0 %, Baker-Ericksen holds in 50.0 %.
    """
    draws = draws_of(tree, **tube)
    radius = (
        radii_of_data(draws.member.data)
        if internal_radius is None
        else checked_radii(internal_radius, **tube)
    )
    extrapolated = warned(draws.extrapolated_radii(radius))
    _, slope = draws.tube.pressure(radius)
    passed: dict[str, Any] = {"pressure_rises": ((slope > 0) & (slope < np.inf)).all(axis=-1)}
    if all(isinstance(layer.energy, _Isotropic) for layer in draws.tube.layers):
        passed["baker_ericksen"] = _baker_ericksen(draws.tube.with_axis(), radius[:, None])
    result = draws.dataset({}, **passed)
    words = {"pressure_rises": "pressure rises", "baker_ericksen": "Baker-Ericksen holds"}
    for name, values in passed.items():
        result[name].attrs = {"long_name": words[name], "fraction": float(values.mean())}
    shares = [f"{words[name]} in {100 * v.mean():.1f} %" for name, v in passed.items()]
    ends, count = f"{radius.min():g} to {radius.max():g} mm", slope[..., 0].size
    result.attrs["summary"] = f"From {ends}, of {count} draws: {', '.join(shares)}."
    if extrapolated is not None:
        at = draws.dataset({"radius": radius}, extrapolated)
        result = result.assign_coords(radius=at["radius"], extrapolated=at["extrapolated"])
    return result


def _baker_ericksen(tube: TubeNumbers, radius: Array) -> Array:
    """Whether the greater stress is in the direction of the greater stretch, in every layer."""
    passed: Any = True
    for layer in tube.layers:
        thickness = layer.outer_radius - layer.inner_radius
        reference = layer.inner_radius + np.linspace(0.0, 1.0, _CIRCLES) * thickness
        circles = tube.circles(layer, radius, reference)
        log_radial = -circles.log_hoop - circles.log_axial
        # Stresses less the radial one. Where they overflow their difference is NaN: nothing holds.
        stress = (np.zeros_like(log_radial), circles.hoop_difference, circles.axial_difference)
        stretch = (log_radial, circles.log_hoop, circles.log_axial)
        with np.errstate(invalid="ignore"):
            holds = [
                (np.abs(stretch[i] - stretch[j]) < _SAME_STRETCH)
                | ((stress[i] - stress[j]) * (stretch[i] - stretch[j]) > 0)
                for i, j in ((0, 1), (1, 2), (2, 0))
            ]
        passed = passed & np.all(holds, axis=(0, -2, -1))
    return passed
