"""What laboratories report of a tube at given pressures, as posteriors."""

from numbers import Real
from typing import Any, Unpack

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.doubt import Check
from pymc_hyperelastic.predictions.draws import GivenTube, checked_pressures, draws_of
from pymc_hyperelastic.predictions.measured import warned


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
