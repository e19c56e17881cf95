"""The likelihood of inflation curves, as a part of a model of the user's own."""

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
from pymc_hyperelastic.models.geometry import split_by_owner
from pymc_hyperelastic.models.likelihoods.base import Likelihood
from pymc_hyperelastic.models.likelihoods.gaussian import as_likelihood
from pymc_hyperelastic.parallel import one_thread


@one_thread
def inflation_likelihood(
    name: str,
    energy: StrainEnergy,
    data: xr.Dataset,
    likelihood: Likelihood | Any,
    parameters: dict[str, Any],
    *,
    mode: Mode = "auto",
) -> TensorVariable:
    """Add the likelihood of inflation curves to the PyMC model of the context, as a Potential.

    Parameters
    ----------
    name : str
        Name of the Potential.
    energy : StrainEnergy
        The material.
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`.
    likelihood : Gaussian, SlopeAugmented, float or variable
        The likelihood, see :class:`~pymc_hyperelastic.Gaussian` and
        :class:`~pymc_hyperelastic.SlopeAugmented`. Its arguments may be variables of the model. A
        number or variable alone is the standard deviation of a pressure, kPa.
    parameters : dict of str to tensor_like
        The material parameters by name: random variables, expressions or numbers. It may also hold
        ``inner_radius``, ``outer_radius`` (mm), ``axial_stretch`` and ``opening_angle`` (rad), in
        place of those of the data: scalars for all tests.
    mode : {"auto", "collocation", "quadrature"}
        How the wall is integrated: by constant matrices, whose cost does not depend on the number
        of points, or by quadrature at every point. "auto" chooses matrices if their curves are
        accurate over the range of the prior; see the theory page "How the wall is integrated".

    Returns
    -------
    TensorVariable
        The Potential, a scalar.

    Raises
    ------
    TypeError
        If the parameters are not those of the strain energy, or no model is in context.
    ValueError
        If the name is taken, the likelihood declares observed variables, the data lack a
        quantity that it needs, or a material parameter has the name of a measure of the tube.

    See Also
    --------
    inflation_model, Gaussian, SlopeAugmented

    Examples
    --------
    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> with pm.Model():
    ...     parameters = {"mu": pm.Gamma("stiffness", 2, 0.1), "alpha": 6.0}
    ...     likelihood = ph.SlopeAugmented(sigma=5 * ph.mmHg, slope_weight=1.0)
    ...     ph.inflation_likelihood("curves", ph.Ogden(), data, likelihood, parameters)
    curves
    """
    if pm.Model.get_context(error_if_none=False) is None:
        raise TypeError("no model is in context: add the likelihood inside `with pm.Model():`")
    # One material only: a wall of layers is a list.
    check_energy(energy)
    likelihood = as_likelihood(likelihood)
    if likelihood.observed:
        raise ValueError(
            "the likelihood has observed=True, but this function adds a Potential: leave observed "
            "away, or call ph.inflation_model inside `with pm.Model():`"
        )
    parameters, geometry = split_by_owner(energy, "parameters", parameters)
    strangers = [key for key in geometry if key not in GEOMETRY]
    if strangers:
        raise ValueError(
            f"parameters holds {strangers[0]!r}; of the measures of the tube it may hold {GEOMETRY}"
        )
    likelihood.check(energy, data, parameters, geometry)
    sizes = {p.name: p.size for p in energy.parameters}
    parameters = {key: _as_tensor(key, value, sizes[key]) for key, value in parameters.items()}
    geometry = {key: _as_tensor(key, value) for key, value in geometry.items()}
    forward = likelihood.forward_model(energy, data, parameters, geometry, mode=mode)
    return pm.Potential(
        name, likelihood.log_likelihood(forward.with_variables(parameters, geometry))
    )


def _as_tensor(name: str, value: Any, size: int | None = None) -> TensorVariable:
    expected = "a scalar" if size is None else f"a vector of {size}"
    try:
        # PyTensor would keep the number 6.0 in single precision.
        tensor = pt.as_tensor(value if isinstance(value, Variable) else np.asarray(value, float))
    except (TypeError, ValueError):
        raise TypeError(f"parameter {name!r} is {value!r}; expected {expected}") from None
    if tensor.type.ndim != (size is not None):
        raise TypeError(
            f"parameter {name!r} has {tensor.type.ndim} dimension(s); expected {expected}"
        )
    if isinstance(tensor, Constant) and not np.all(np.isfinite(tensor.data)):
        raise ValueError(f"parameter {name!r} is {value}; expected finite numbers")
    return tensor
