"""Independent Gaussian errors of pressures, forces and diameters."""

from dataclasses import dataclass, field
from numbers import Real
from typing import Any, ClassVar

from pytensor.graph.basic import Variable

from pymc_hyperelastic.models.likelihoods.base import Likelihood
from pymc_hyperelastic.models.likelihoods.errors import check_size


@dataclass(frozen=True, repr=False)
class Gaussian(Likelihood):
    r"""Likelihood of independent Gaussian measurement errors, given as standard deviations.

    With the model's pressures ``p``, axial forces ``F`` and the measured values ``y``,

    .. math:: y_i \sim N(p_i, s_p^2), \qquad
        F^{\text{meas}}_i \sim N(F_i + o_{t(i)}, s_F^2), \qquad o_t \sim N(0, s_o^2).

    The offset ``o`` of the force transducer, one for each test ``t``, is integrated out. Stresses
    of sheets have independent errors, ``σ^meas_i ~ N(σ_i, s_σ²)``, of the stress that was measured:
    Cauchy or nominal.

    Parameters
    ----------
    pressure_sd : float or distribution
        Standard deviation ``s_p`` of a measured pressure, kPa.
    radius_sd : float or distribution, optional
        In place of `pressure_sd`, for steep curves: standard deviation of a measured internal
        radius, or of half an outer diameter, mm. Pressures are then exact: measured radii and
        forces are compared with those of the model at the measured pressure.
    force_sd : float or distribution, optional
        Standard deviation ``s_F`` of a measured axial force, mN. Without it forces are left out.
    force_offset_sd : float or distribution, optional
        Standard deviation ``s_o`` of the offset of the force transducer, mN.
        :func:`~pymc_hyperelastic.force_offsets` returns what is learned of the offsets.
    diameter_sd : float or distribution, optional
        Standard deviation ``s_D`` of a measured outer diameter, or of twice a measured internal
        radius, mm, besides the error of the pressure. See the notes.
    stress_sd : float or distribution, optional
        Standard deviation ``s_σ`` of a measured stress of a sheet, kPa. Data of sheets alone need
        no `pressure_sd`; data of tubes and sheets need both.
    stretch_sd : float or distribution, optional
        Standard deviation of a measured stretch of a sheet, besides the error of the stress. See
        the notes.
    observed : bool, default False
        If True, a model declares observed variables, ``measured_pressure``,
        ``measured_axial_force``, ``measured_stress_x`` and ``measured_stress_y``, in place of the
        Potential ``likelihood``. PyMC can then draw predictions, and ArviZ can compute LOO.

    Raises
    ------
    TypeError
        If an argument is neither a number nor a scalar distribution.
    ValueError
        If a number is impossible, or arguments exclude each other.

    See Also
    --------
    SlopeAugmented, inflation_model

    Notes
    -----
    A distribution, such as ``pm.HalfNormal.dist(1)``, makes the standard deviation an unknown of
    the model, under the name of the argument.

    An error of the diameter shifts the pressure and the force of a point together, along the
    curves. With the model's slopes ``p'`` and ``F'`` by the measured radius and ``s_r = s_D/2``,
    both errors of a point have, to first order, the covariance

    .. math:: \begin{pmatrix} s_p^2 & 0 \\ 0 & s_F^2 \end{pmatrix}
        + s_r^2 \begin{pmatrix} p'^2 & p' F' \\ p' F' & F'^2 \end{pmatrix}.

    An error of a stretch shifts both stresses of a point in the same way, by their derivatives by
    the measured stretches.

    Do not use either where the slope changes by more than a tenth over one standard deviation,
    ``κ = s_D |p''/p'| > 0.1``: the theory page on likelihoods has a table of errors.

    Examples
    --------
    >>> import numpy as np, pymc as pm, pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> data = data.assign(axial_force=("obs", np.full(data.sizes["obs"], 50.0)))
    >>> forces = {"force_sd": pm.HalfNormal.dist(10), "force_offset_sd": 100.0}
    >>> likelihood = ph.Gaussian(pressure_sd=0.5, **forces)
    >>> likelihood
    Gaussian(pressure_sd=0.5, force_sd=HalfNormal(0, 10), force_offset_sd=100.0)
    >>> model = ph.inflation_model(ph.Ogden(), data, likelihood)
    >>> [rv.name for rv in model.free_RVs]
    ['mu', 'alpha', 'force_sd']
    """

    pressure_sd: Any = None
    radius_sd: Any = field(default=None, kw_only=True)
    force_sd: Any = field(default=None, kw_only=True)
    force_offset_sd: Any = field(default=None, kw_only=True)
    diameter_sd: Any = field(default=None, kw_only=True)
    stress_sd: Any = field(default=None, kw_only=True)
    stretch_sd: Any = field(default=None, kw_only=True)

    force_name: ClassVar[str] = "force_sd"

    def __post_init__(self) -> None:
        """Refuse errors of pressures and radii that exclude each other, or cannot be drawn."""
        super().__post_init__()
        if self.stretch_sd is not None and self.stress_sd is None:
            raise ValueError(
                "stretch_sd is given without stress_sd: give the standard deviation of a stress, "
                "kPa, too"
            )
        if self.radius_sd is None:
            if not self.with_sheets or {"force_sd", "diameter_sd"} & self.sizes.keys():
                check_size("pressure_sd", self.pressure_sd)
            return
        for name in ("pressure_sd", "diameter_sd"):
            if name in self.sizes:
                raise ValueError(
                    f"radius_sd and {name} are both given, but with radius_sd (mm) the radius has "
                    f"the only error, and pressures are exact: leave {name} away; or, if both have "
                    "errors, give pressure_sd (kPa) and diameter_sd (mm, twice that of a radius)"
                )
        if self.observed:
            raise ValueError(
                "radius_sd is given, but observed variables (observed=True, and wherever specimens "
                "differ) are pressures at known radii: give pressure_sd (kPa), and the error of "
                "diameters as diameter_sd (mm)"
            )


def as_likelihood(likelihood: Any) -> Likelihood:
    """Return a likelihood; a number or a distribution is the standard deviation of a pressure, kPa.

    Examples
    --------
    >>> as_likelihood(0.5)
    Gaussian(pressure_sd=0.5)
    """
    if isinstance(likelihood, Likelihood):
        return likelihood
    if isinstance(likelihood, Real | Variable) and not isinstance(likelihood, bool):
        return Gaussian(pressure_sd=likelihood)
    raise TypeError(
        f"likelihood is {likelihood!r}; expected ph.Gaussian(pressure_sd=2 * ph.mmHg), "
        "ph.SlopeAugmented(sigma=5 * ph.mmHg, slope_weight=1.0), or the standard deviation of a "
        "pressure in kPa, a number or a distribution"
    )
