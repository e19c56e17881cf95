"""The paper's likelihood: errors of pressures and of the slopes of their curves."""

from dataclasses import dataclass, field
from typing import Any, ClassVar

from pymc_hyperelastic.models.likelihoods.base import Likelihood
from pymc_hyperelastic.models.priors import is_inferred


@dataclass(frozen=True, repr=False)
class SlopeAugmented(Likelihood):
    r"""The paper's likelihood, in which the slopes of the curves count besides the pressures.

    With ``Δp`` the model's pressures minus the measured ones, ``Δs`` its stiffnesses minus the
    central differences ``(p[i+1] − p[i−1])/(r[i+1] − r[i−1])`` at the interior points of each
    test, and ``D`` the matrix of these differences,

    .. math::

        \ln L = -\frac{|Δp|^2}{σ^2} - \frac{β}{σ^2} |Δs|^2
            - \frac{N}{2} \ln(π σ^2) + \frac12 \ln\det(I + β D^T D).

    The first two terms are the paper's. The others do not depend on the material: they normalise
    the likelihood as a density of the pressures, except for the small gap between the model's
    slopes and the differences of its own pressures. Evidences are therefore absolute, and ``σ`` and
    ``β`` can be inferred. There is no factor ½ with ``σ``: it is ``√2`` standard deviations.

    Parameters
    ----------
    sigma : float or distribution
        The paper's ``σ`` of pressures, kPa: ``√2`` standard deviations without slopes, which make
        errors smaller.
    slope_weight : float or distribution
        The paper's ``β``, mm². With 0 the likelihood is that of :class:`Gaussian`. Tests in which
        the axial stretch varies have no slopes.
    force_sigma : float or distribution, optional
        The paper's ``σ`` of axial forces, mN: ``√2`` standard deviations. It adds
        ``−|ΔF|²/σ_F² − (N_F/2) ln(π σ_F²)``. Without it forces are left out.
    force_offset_sd : float or distribution, optional
        Standard deviation of the offset of the force transducer, mN, see :class:`Gaussian`.
    observed : bool, default False
        If True, a model declares observed variables in place of the Potential ``likelihood``.
        `slope_weight` must then be a number.

    Raises
    ------
    TypeError
        If an argument is neither a number nor a scalar distribution.
    ValueError
        If a number is impossible, or arguments exclude each other.

    See Also
    --------
    Gaussian, balanced_slope_weight, inflation_model

    Notes
    -----
    With ``observed=True`` the measured pressures ``y`` of each test are the observed variable
    ``measured_pressure``. With the model's pressures ``m`` and slopes ``s``,

    .. math:: y \sim \mathcal{N}\left(P^{-1} (m + β D^T s),\ \tfrac{σ^2}{2} P^{-1}\right),
        \qquad P = I + β D^T D.

    This is the same form without its factor for the gap between ``s`` and ``D m``. It has a
    log-likelihood by points, each given the points before it in its test.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> likelihood = ph.SlopeAugmented(sigma=0.7, slope_weight=1.0)
    >>> likelihood
    SlopeAugmented(sigma=0.7, slope_weight=1.0)
    >>> model = ph.inflation_model(ph.Ogden(), data, likelihood)
    >>> [potential.name for potential in model.potentials]
    ['likelihood']
    """

    sigma: Any
    slope_weight: Any
    force_sigma: Any = field(default=None, kw_only=True)
    force_offset_sd: Any = field(default=None, kw_only=True)

    force_name: ClassVar[str] = "force_sigma"

    def __post_init__(self) -> None:
        """Refuse observed pressures with an unknown slope weight."""
        super().__post_init__()
        if self.observed and is_inferred(self.slope_weight):
            raise ValueError(
                "slope_weight is a distribution, but where pressures are observed variables "
                "(observed=True, and wherever specimens differ) it must be a number of mm², such "
                "as ph.balanced_slope_weight(data)"
            )
