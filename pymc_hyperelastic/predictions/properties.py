"""What laboratories report of a tube at given pressures, as posteriors."""

from numbers import Real
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
    draws_of,
)
from pymc_hyperelastic.predictions.in_vivo import between_pressures
from pymc_hyperelastic.predictions.measured import warned

# Without a measured force, what is said of the axial direction rests on the law and its prior.
_AXIAL = ("axial_stress", "axial_material_stiffness", "in_vivo_axial_stretch")


@one_thread
def tube_properties(
    tree: xr.DataTree,
    pressure: Any,
    *,
    pressure_range: Any = None,
    density: float = 1060.0,
    pressure_unit: str = "kPa",
    check: Check = "warn",
    **tube: Unpack[GivenTube],
) -> xr.Dataset:
    r"""Posterior of the elastic properties that are reported of a vessel, at given pressures.

    They are those of the tube at its axial stretch, at the radius of :func:`radius_at_pressure`,
    which also says what is warned of, and what is an error.

    What concerns the axial direction is hardly told by pressures: it is as credible as the law is,
    unless axial forces were measured and fitted, at more than one axial stretch.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    pressure : array_like, shape (pressure,)
        Internal pressures, in `pressure_unit`.
    pressure_range : pair of float, optional
        Diastolic and systolic pressure, in `pressure_unit`: with them the result also has the in
        vivo axial stretch, and what energy the wall stores in between.
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

        ``circumferential_stress`` : ``p a/(b − a)``, kPa, by equilibrium the mean of the Cauchy
        stress ``σθθ`` over the thickness of the wall.

        ``axial_stress`` : ``(F + π a² p)/(π (b² − a²))`` with the reduced axial force ``F``, kPa,
        by equilibrium the mean of ``σzz`` over the area of the wall.

        ``circumferential_material_stiffness``, ``axial_material_stiffness`` : ``∂²Ŵ/∂(ln λθ)²``
        and ``∂²Ŵ/∂(ln λz)²``, kPa, linearised about the inflated tube, as means over the area of
        the wall [5]_; see below.

        ``stored_energy`` : ``Ŵ`` per unit of volume, less that of the stress-free state, as a mean
        over the wall, kPa, which is kJ/m³ [6]_.

        With a `pressure_range` also, with dimensions (chain, draw):

        ``stored_energy_change`` : the stored energy at the systolic pressure less that at the
        diastolic one, at the axial stretch of the tube, kPa.

        ``in_vivo_axial_stretch`` : the least axial stretch ``λz`` between 0.8 and 2.5 at which the
        reduced axial force is the same at both pressures, ``F(p_sys, λz) = F(p_dia, λz)``: in a
        shorter tube the force falls when it is inflated, in a longer one it rises. NaN where there
        is none; the attribute ``draws_without`` counts these draws.

        The coordinate ``extrapolated`` (pressure) is that of :func:`radius_at_pressure`. The
        scalars ``range_extrapolated`` and ``in_vivo_extrapolated`` say likewise of the two
        pressures whether one of them is extrapolated at the axial stretch of the tube, and at the
        median of the in vivo stretch.

    Warns
    -----
    UserWarning
        If some draws do not reach a pressure, or something is extrapolated. With a
        `pressure_range`, if some draws have no in vivo stretch, or it was found without an axial
        force among the result's data.

    Raises
    ------
    ValueError
        If the density is not positive, or the `pressure_range` not two rising pressures from 0 up.

    See Also
    --------
    plot_elastic_properties, pulse_wave_velocity

    Notes
    -----
    The material stiffness is that of small strains that are superposed on large ones, at constant
    radial stress and with the other stretch held: of ``Ŵ(λθ, λz) = W(1/(λθ λz), λθ, λz)``, the
    energy of the incompressible wall,

    .. math::

        C_θ = \frac{∂(σ_{θθ} - σ_{rr})}{∂\ln λ_θ}
            = 2 (σ_{θθ} - σ_{rr}) + 4 λ_θ^4 \frac{∂^2 \hat W}{∂(λ_θ^2)^2}
            = \mathcal{C}_{θθθθ} - 2 \mathcal{C}_{θθrr} + \mathcal{C}_{rrrr}, \qquad
        \mathcal{C}_{iijj} = \frac{∂^2 W}{∂\ln λ_i \, ∂\ln λ_j},

    and the same in the axial direction. Articles differ in what they call stiffness [7]_. The
    :math:`\mathcal{C}` are the components of Baek et al. [5]_, and often
    :math:`\mathcal{C}_{θθθθ}` alone is reported: it takes the stretches for independent, and
    changes when a function of the volume is added to ``W``, which is the same incompressible
    material. The combination does not. For fibres in a neo-Hookean matrix of modulus ``c`` it is
    larger than the one component by ``2 c λr²``, a percent in an inflated artery. At rest an
    isotropic wall has four times its shear modulus, Young's modulus over ``1 − ν²``.

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
    .. [5] S. Baek, R. L. Gleason, K. R. Rajagopal, J. D. Humphrey, Theory of small on large:
       potential utility in computations of fluid-solid interactions in arteries, Computer Methods
       in Applied Mechanics and Engineering 196 (2007) 3070-3078.
    .. [6] J. Ferruzzi, M. R. Bersi, J. D. Humphrey, Biomechanical phenotyping of central arteries
       in health and disease: advantages of and methods for murine models, Annals of Biomedical
       Engineering 41 (2013) 1311-1330.
    .. [7] B. Spronck, J. D. Humphrey, Arterial stiffness: different metrics, different meanings,
       Journal of Biomechanical Engineering 141 (2019) 091004.

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
    >>> properties["circumferential_material_stiffness"].values.round(6).ravel()
    array([ 80., 120.])

    The stretch at which the force is the same at 80 and at 120 mmHg, of a stiffening tube:

    >>> law = {"c": 20.0, "a1": 0.8, "a2": 0.6, "a4": 0.1}
    >>> posterior = xr.Dataset({n: (("chain", "draw"), [[x]]) for n, x in law.items()})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> tube = {"energy": ph.FungOrthotropic(), "inner_radius": 0.44, "outer_radius": 0.55}
    >>> in_mmhg = {"pressure_unit": "mmHg", "pressure_range": (80, 120)}
    >>> properties = ph.tube_properties(tree, 100, **tube, **in_mmhg)
    >>> round(properties["in_vivo_axial_stretch"].item(), 3)
    1.789
    """
    _check_density(density)
    draws = draws_of(tree, **tube)
    pressure = checked_pressures(pressure, pressure_unit, check)
    if pressure_range is not None:
        pressure_range = _checked_range(pressure_range, pressure_unit, check)
    a = draws.radius_at(pressure)
    extrapolated = warned(draws.extrapolated_pressures(pressure, a, pressure_unit))
    properties = _of_the_curve(draws, a, density) | _of_the_wall(draws, a, pressure)
    result = draws.dataset({"pressure": pressure}, extrapolated, **properties)
    if pressure_range is not None:
        between = between_pressures(draws, pressure_range, pressure_unit)
        result = result.assign(between.data_vars).assign_coords(between.coords)
    if draws.without_force:
        for name in set(_AXIAL) & set(result):
            result[name].attrs["comment"] = "no axial force was measured: it rests on the law"
    return result


@one_thread
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

    See Also
    --------
    tube_properties

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
    _check_density(density)
    draws = draws_of(tree, **tube)
    pressure = checked_pressures(pressure, pressure_unit, check)
    a = draws.radius_at(pressure)
    extrapolated = warned(draws.extrapolated_pressures(pressure, a, pressure_unit))
    speed = _of_the_curve(draws, a, density)["pulse_wave_velocity"]
    return draws.dataset({"pressure": pressure}, extrapolated, pulse_wave_velocity=speed)


def _of_the_curve(draws: Draws, a: Array, density: float) -> dict[str, Array]:
    """Properties that follow from radii and the slope of the curve."""
    _, slope = draws.tube.pressure(a)
    b = draws.tube.current(draws.tube.geometry["outer_radius"], a)
    per_area = 2 / (a * slope)
    return {
        "radius": a,
        "outer_radius": b,
        "stiffness": slope,
        "compliance": np.pi * a**2 * per_area,
        "distensibility": per_area,
        "peterson_modulus": a * slope,
        "incremental_modulus": 1.5 * a**2 * b / ((b - a) * (b + a)) * (b / a * slope),
        # 1000 Pa in a kPa: then the velocity is in m/s.
        "pulse_wave_velocity": np.sqrt(1000 / (density * per_area)),
    }


def _of_the_wall(draws: Draws, a: Array, pressure: Array) -> dict[str, Array]:
    """Stresses, stiffness and energy of the material, as means over the wall."""
    tube = draws.tube
    b = tube.current(tube.geometry["outer_radius"], a)
    thickness = tube.wall_area / (np.pi * (a + b))
    means = tube.wall_means(a)
    return {
        "circumferential_stress": pressure * a / thickness,
        "axial_stress": (tube.axial_force(a) + np.pi * a**2 * pressure) / tube.wall_area,
        "circumferential_material_stiffness": means.hoop_stiffness,
        "axial_material_stiffness": means.axial_stiffness,
        "stored_energy": means.energy,
    }


def _check_density(density: float) -> None:
    """Raise for what is no density."""
    if not (isinstance(density, Real) and 0 < density < np.inf):
        raise ValueError(f"density must be a positive number in kg/m³; got {density!r}")


def _checked_range(pressure_range: Any, unit: str, check: Check) -> Array:
    """Diastolic and systolic pressure, kPa."""
    words = f"pressure_range must be a diastolic and a higher systolic pressure in {unit}; got "
    if np.shape(pressure_range) != (2,):
        raise ValueError(f"{words}{pressure_range!r}")
    pressures = checked_pressures(pressure_range, unit, check)
    if not 0 <= pressures[0] < pressures[1]:
        raise ValueError(f"{words}{pressure_range!r}")
    return pressures
