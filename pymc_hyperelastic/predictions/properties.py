"""Compute posteriors of the elastic properties that laboratories report, at given pressures."""

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
from pymc_hyperelastic.predictions.draws import Array, Draws, draws_of
from pymc_hyperelastic.predictions.in_vivo import between_pressures

# Properties that are marked with a comment if no axial force was measured: pressures alone hardly
# inform about them.
_AXIAL = ("axial_force", "axial_stress", "axial_material_stiffness", "in_vivo_axial_stretch")


@one_thread
def tube_properties(
    result: xr.DataTree,
    at: Conditions | Any,
    *,
    specimen: str | None = None,
    energy: StrainEnergy | Sequence[Layer] | None = None,
    check: Check = "warn",
) -> xr.Dataset:
    r"""Compute the posterior of the elastic properties of a vessel at given pressures.

    The properties belong to the tube at its axial stretch, and at the radius that
    :func:`radius_at_pressure` returns, with the same warnings and errors.

    Pressures hardly inform about axial properties. These are only as credible as the strain energy,
    unless axial forces were measured and fitted at more than one axial stretch.

    Parameters
    ----------
    result : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    at : Conditions, or array_like of pressures in kPa, shape (pressure,)
        The pressures, the tube and the density ``ρ`` of the fluid. If a ``pressure_range`` is
        stated, the result also has the in vivo axial stretch, and the change of the stored energy
        between the diastolic and the systolic pressure.
    specimen, energy
        See :func:`predict_pressure`.
    check : {"warn", "raise", "ignore"}
        Action if a pressure is above 40 kPa (300 mmHg), which was probably meant in mmHg.

    Returns
    -------
    xarray.Dataset
        Variables with dimensions (chain, draw, pressure), if `at` states pressures, where
        ``A = π a²`` is the area of the lumen:

        ``radius`` : internal radius ``a``, mm.

        ``outer_radius`` : current outer radius ``b``, mm, ``b² = a² + (B² − A₀²)/(k λz)`` from the
        reference radii ``A₀ < B``.

        ``stiffness`` : ``dp/da``, kPa/mm.

        ``compliance`` : ``dA/dp = 2π a/(dp/da)``, mm²/kPa [1]_.

        ``distensibility`` : ``(dA/dp)/A = 2/(a dp/da)``, 1/kPa [1]_.

        ``peterson_modulus`` : pressure-strain modulus ``dp/(dd/d) = a dp/da`` of the internal
        diameter ``d``, kPa [2]_.

        ``incremental_modulus`` : ``2 (1 − ν²) a² b/(b² − a²) · dp/db`` with ``ν = ½`` and, because
        the wall is incompressible, ``dp/db = (b/a) dp/da``, kPa. It is Young's modulus of the
        linear isotropic tube with the same slope [3]_.

        ``pulse_wave_velocity`` : ``√(A/(ρ dA/dp))``, m/s [4]_.

        ``circumferential_stress`` : ``p a/(b − a)``, kPa, by equilibrium the mean of the Cauchy
        stress ``σθθ`` over the thickness of the wall.

        ``axial_force`` : reduced axial force ``F``, mN, see :func:`predict_axial_force`.

        ``axial_stress`` : ``(F + π a² p)/(π (b² − a²))``, kPa, by equilibrium the mean of ``σzz``
        over the area of the wall.

        ``circumferential_material_stiffness``, ``axial_material_stiffness`` : ``∂²Ŵ/∂(ln λθ)²``
        and ``∂²Ŵ/∂(ln λz)²``, kPa, linearised about the inflated tube, as means over the area of
        the wall [5]_; see below.

        ``stored_energy`` : energy density ``Ŵ`` relative to the stress-free state, as a mean over
        the wall, kPa, equal to kJ/m³ [6]_.

        If a ``pressure_range`` is stated, also variables with dimensions (chain, draw):

        ``stored_energy_change`` : stored energy at the systolic pressure minus stored energy at the
        diastolic pressure, at the axial stretch of the tube, kPa.

        ``in_vivo_axial_stretch`` : the smallest axial stretch ``λz`` between 0.8 and 2.5 at which
        the reduced axial force is equal at both pressures, ``F(p_sys, λz) = F(p_dia, λz)``, and
        changes from falling with pressure (in a shorter tube) to rising (in a longer one). NaN for
        draws without such a stretch; the attribute ``draws_without`` is the number of these draws.

        The coordinates ``pressure`` and ``extrapolated`` are described in
        :func:`radius_at_pressure`. The scalar coordinates ``range_extrapolated`` and
        ``in_vivo_extrapolated`` are True if the diastolic or the systolic pressure is extrapolated,
        at the axial stretch of the tube and at the median in vivo stretch.

    Warns
    -----
    UserWarning
        If some draws do not reach a pressure, or a pressure is extrapolated. With a
        ``pressure_range``, also if some draws have no in vivo stretch, or if the result's data have
        no axial force.

    Raises
    ------
    ValueError
        If `at` states no pressure, or no draw reaches a pressure.

    See Also
    --------
    plot_elastic_properties, Conditions

    Notes
    -----
    The material stiffness describes small strains superposed on large ones, at constant radial
    stress and with the other stretch held. It follows from ``Ŵ(λθ, λz) = W(1/(λθ λz), λθ, λz)``,
    the energy of the incompressible wall,

    .. math::

        C_θ = \frac{∂(σ_{θθ} - σ_{rr})}{∂\ln λ_θ}
            = 2 (σ_{θθ} - σ_{rr}) + 4 λ_θ^4 \frac{∂^2 \hat W}{∂(λ_θ^2)^2}
            = \mathcal{C}_{θθθθ} - 2 \mathcal{C}_{θθrr} + \mathcal{C}_{rrrr}, \qquad
        \mathcal{C}_{iijj} = \frac{∂^2 W}{∂\ln λ_i \, ∂\ln λ_j},

    and correspondingly in the axial direction. Articles define stiffness in different ways [7]_.
    The :math:`\mathcal{C}` are the components of Baek et al. [5]_. Many articles report
    :math:`\mathcal{C}_{θθθθ}` alone, which treats the stretches as independent. It changes if a
    function of the volume is added to ``W``, although this does not change the incompressible
    material; ``C_θ`` does not change. For fibres in a neo-Hookean matrix of modulus ``c``, ``C_θ``
    exceeds :math:`\mathcal{C}_{θθθθ}` by ``2 c λr²``, about one percent in an inflated artery. At
    rest, ``C_θ`` of an isotropic wall is four times the shear modulus, which is Young's modulus
    divided by ``1 − ν²``.

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
    At rest the incremental modulus of an isotropic tube is Young's modulus, three times the shear
    modulus:

    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, 30.0]])})
    >>> result = xr.DataTree.from_dict({"posterior": posterior})
    >>> at = ph.Conditions(0.0, tube=ph.Tube(7.0, 9.0))
    >>> properties = ph.tube_properties(result, at, energy=ph.NeoHookean())
    >>> properties["incremental_modulus"].values.round(6).ravel()
    array([60., 90.])
    >>> properties["pulse_wave_velocity"].values.round(3).ravel()
    array([2.73 , 3.344])
    >>> properties["circumferential_material_stiffness"].values.round(6).ravel()
    array([ 80., 120.])

    In vivo axial stretch of a stiffening tube, at which the forces at 80 and 120 mmHg are equal:

    >>> law = {"c": 20.0, "a1": 0.8, "a2": 0.6, "a4": 0.1}
    >>> posterior = xr.Dataset({n: (("chain", "draw"), [[x]]) for n, x in law.items()})
    >>> result = xr.DataTree.from_dict({"posterior": posterior})
    >>> in_mmhg = {"pressure_unit": "mmHg", "pressure_range": (80, 120)}
    >>> at = ph.Conditions(100, tube=ph.Tube(0.44, 0.55), **in_mmhg)
    >>> properties = ph.tube_properties(result, at, energy=ph.FungOrthotropic())
    >>> round(properties["in_vivo_axial_stretch"].item(), 3)
    1.789
    """
    at = as_conditions(at)
    draws = draws_of(result, at.tube, specimen, energy)
    found = xr.Dataset()
    if at.pressure is not None or at.pressure_range is None:
        pressure, a, extrapolated = inflated(draws, at, check)
        properties = _of_the_curve(draws, a, at.density) | _of_the_wall(draws, a, pressure)
        found = at.label_pressures(
            draws.dataset({"pressure": pressure}, extrapolated, **properties)
        )
    if at.pressure_range is not None:
        between = between_pressures(draws, at, check)
        found = found.assign(between.data_vars).assign_coords(between.coords)
        found.attrs |= between.attrs
    if draws.without_force:
        for name in set(_AXIAL) & set(found):
            found[name].attrs["comment"] = (
                "no axial force was measured: the value rests on the strain energy and its prior"
            )
    return found


def _of_the_curve(draws: Draws, a: Array, density: float) -> dict[str, Array]:
    """Return the properties that depend on radii and the slope ``dp/da`` only."""
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
        # 1000 Pa per kPa gives a velocity in m/s.
        "pulse_wave_velocity": np.sqrt(1000 / (density * per_area)),
    }


def _of_the_wall(draws: Draws, a: Array, pressure: Array) -> dict[str, Array]:
    """Return axial force, mN, and stresses, stiffness and energy, kPa, as means over the wall."""
    tube = draws.tube
    b = tube.current(tube.geometry["outer_radius"], a)
    thickness = tube.wall_area / (np.pi * (a + b))
    force, means = tube.axial_force(a), tube.wall_means(a)
    return {
        "circumferential_stress": pressure * a / thickness,
        "axial_force": force,
        "axial_stress": (force + np.pi * a**2 * pressure) / tube.wall_area,
        "circumferential_material_stiffness": means.hoop_stiffness,
        "axial_material_stiffness": means.axial_stiffness,
        "stored_energy": means.energy,
    }
