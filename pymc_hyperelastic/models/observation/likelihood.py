"""The likelihood of inflation curves, as a part of a model of the user's own."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from pytensor.graph.basic import Constant, Variable
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.mechanics.layers import check_energy
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.forward import Mode
from pymc_hyperelastic.models.observation.observation import ErrorIn, Observation


def inflation_likelihood(
    name: str,
    energy: StrainEnergy,
    data: xr.Dataset,
    parameters: dict[str, Any],
    *,
    noise_sd: Any = None,
    sigma: Any = None,
    slope_weight: Any,
    force_noise_sd: Any = None,
    force_sigma: Any = None,
    force_offset_sd: Any = None,
    diameter_noise_sd: Any = None,
    error_in: ErrorIn = "pressure",
    geometry: Mapping[str, Any] | None = None,
    mode: Mode = "auto",
) -> TensorVariable:
    r"""Add the likelihood of inflation curves to the PyMC model of the context, as a Potential.

    With ``Δp`` the model's pressures minus the measured ones, ``Δs`` its stiffnesses minus the
    central differences ``(p[i+1] − p[i−1])/(r[i+1] − r[i−1])`` at the interior points of each
    test, and ``D`` the matrix of these differences,

    .. math::

        \ln L = -\frac{|Δp|^2}{σ^2} - \frac{β}{σ^2} |Δs|^2
            - \frac{N}{2} \ln(π σ^2) + \frac12 \ln\det(I + β D^T D).

    The first two terms are the paper's. The others do not depend on the material: they normalise
    the likelihood as a density of the pressures, but for the small gap between the model's slopes
    and the differences of its own pressures, so that evidences are absolute and ``σ`` and ``β``
    can be inferred. There is no factor ½ with ``σ``, which is ``√2`` standard deviations.
    Where the pressure of a parameter overflows, the log-likelihood is ``−inf`` and its gradient 0.

    With the error in the radius, ``Δr`` replaces ``Δp``: the radius at which the model has the
    measured pressure minus the measured one (half of an outer diameter).

    With ``σ_F`` (`force_noise_sd` is ``σ_F/√2``), measured axial forces add
    ``−|ΔF|²/σ_F² − (N_F/2) ln(π σ_F²)``. The model's force is that at the measured radius, or with
    the error in the radius at its own.

    Tests in which the axial stretch varies have no slopes, and no rows in ``D``.

    With an offset of the transducer, one for all ``n`` forces of a test and normal with the
    standard deviation ``s`` (`force_offset_sd`), errors of forces have the covariance
    ``v I + s² 1 1ᵀ``, ``v = σ_F²/2``. For each test it adds, exactly,

    .. math:: \frac{s^2 (\sum_i ΔF_i)^2}{2 v (v + n s^2)} - \frac12 \ln\left(1 + n s^2/v\right) .

    With an error of the diameter, of the standard deviation ``2 s_r`` (`diameter_noise_sd`), errors
    of pressure and force of a point have the covariance

    .. math:: \begin{pmatrix} σ^2/2 & 0 \\ 0 & σ_F^2/2 \end{pmatrix}
        + s_r^2 \begin{pmatrix} p'^2 & p' F' \\ p' F' & F'^2 \end{pmatrix},

    with the slopes ``p'`` and ``F'`` of the model by the radius that was measured, there. They
    depend on the material, and with them the normaliser, which is part of the likelihood. This is
    the integral over the true diameter, a flat prior given, for curves that are straight over the
    error. What matters is by which share the slope changes over one standard deviation of the
    diameter, ``κ = s_D |p''/p'|``: of a curve that grows as ``exp(D/ℓ)`` it is ``s_D/ℓ``. Of a
    mouse aorta of 1.3 mm with fibres, between 50 and 120 mmHg with errors of 1 mmHg and 0.5 mN, the
    log-likelihood of a point differs from the integral by 0.02 nats (root mean square) for 5 µm,
    with κ up to 0.02, and by 0.06 for 10 µm, κ up to 0.04; on average by 0.001. Parameters from 100
    points are off by a tenth of their standard deviation. For 40 µm, κ up to 0.15, it is half a
    nat, and they are off by a whole one: do not trust it there.

    Parameters
    ----------
    name : str
        Name of the Potential.
    energy : StrainEnergy
        The material.
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`.
    parameters : dict of str to tensor_like
        The material parameters by name: random variables, expressions or numbers.
    noise_sd : tensor_like
        Standard deviation of the errors, ``σ/√2``, kPa, or mm if the error is in the radius; a
        number or a random variable. With slopes it is a bound on that of a pressure.
    sigma : tensor_like
        In place of `noise_sd` the paper's ``σ``, which is ``√2`` standard deviations.
    slope_weight : tensor_like
        The paper's ``β``, mm²; a number or a random variable. With the number 0 slopes play no
        part. See :func:`~pymc_hyperelastic.balanced_slope_weight`.
    force_noise_sd, force_sigma : tensor_like, optional
        The same for axial forces, mN; without one of them they play no part.
    force_offset_sd : tensor_like, optional
        Standard deviation of the offset that the forces of a test share, mN.
    diameter_noise_sd : tensor_like, optional
        Standard deviation of the error of a measured outer diameter, or of twice a measured
        internal radius, mm. Slopes then play no part, and points are not compressed.
    error_in : {"pressure", "radius"}
        What was measured with an error. Where curves are steep it is the radius; slopes then play
        no part.
    geometry : dict of str to tensor_like, optional
        What of ``inner_radius``, ``outer_radius`` (mm), ``axial_stretch`` and ``opening_angle``
        (rad) is not to be taken from the data, as for an unknown unloaded radius: scalars, of all
        tests alike.
    mode : {"auto", "collocation", "quadrature"}
        How the integral over the wall is taken. With "auto" it is a constant matrix, whose cost
        does not depend on the number of points, where that reaches rounding error over the range of
        the parameters' prior, and else direct quadrature at every point.

    Returns
    -------
    TensorVariable
        The Potential, a scalar.

    Raises
    ------
    TypeError
        If the parameters are not those of the strain energy, something is not a scalar, no model is
        in context, or an error is not given, or twice.
    ValueError
        If the name is taken, an error or `slope_weight` is an impossible number, or a test has too
        few points or repeated radii for a slope.

    See Also
    --------
    inflation_model, balanced_slope_weight

    Examples
    --------
    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> with pm.Model():
    ...     stiffness = pm.Gamma("stiffness", 2, 0.1)
    ...     potential = ph.inflation_likelihood(
    ...         "curves",
    ...         ph.Ogden(),
    ...         data,
    ...         {"mu": stiffness, "alpha": 6.0},
    ...         sigma=5 * ph.mmHg,
    ...         slope_weight=1.0,
    ...     )
    """
    if pm.Model.get_context(error_if_none=False) is None:
        raise TypeError("no model is in context: add the likelihood inside `with pm.Model():`")
    check_energy(energy)
    if geometry is not None and not isinstance(geometry, Mapping):
        raise TypeError(
            f"geometry must be a dict with keys of {GEOMETRY}, not {type(geometry).__name__}"
        )
    strangers = [key for key in geometry or {} if key not in GEOMETRY]
    if strangers:
        raise ValueError(f"geometry holds {strangers[0]!r}; it may hold {GEOMETRY}")
    noise = {"noise_sd": noise_sd, "force_noise_sd": force_noise_sd}
    noise |= {"force_offset_sd": force_offset_sd, "diameter_noise_sd": diameter_noise_sd}
    observation = Observation(sigma, slope_weight, force_sigma, error_in, **noise)
    observation.check(energy, data, parameters, geometry)
    sizes = {p.name: p.size for p in energy.parameters}
    parameters = {key: _as_tensor(key, value, sizes[key]) for key, value in parameters.items()}
    geometry = {key: _as_tensor(key, value) for key, value in (geometry or {}).items()}
    forward = observation.forward_model(energy, data, parameters, geometry, mode=mode)
    return pm.Potential(name, observation.log_likelihood(forward.tube(parameters, geometry)))


def _as_tensor(name: str, value: Any, size: int | None = None) -> TensorVariable:
    try:
        # As 6.0, PyTensor would keep a number in single precision.
        tensor = pt.as_tensor(value if isinstance(value, Variable) else np.asarray(value, float))
    except (TypeError, ValueError):
        raise TypeError(
            f"parameter {name!r} is {value!r}; expected a number, an expression or a random "
            "variable"
        ) from None
    if tensor.type.ndim != (size is not None):
        expected = "a scalar" if size is None else f"a vector of {size}"
        raise TypeError(
            f"parameter {name!r} has {tensor.type.ndim} dimension(s); expected {expected}"
        )
    if isinstance(tensor, Constant) and not np.all(np.isfinite(tensor.data)):
        raise ValueError(f"parameter {name!r} is {value}; expected a finite number")
    return tensor
