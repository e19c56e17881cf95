"""The slope-augmented likelihood of inflation curves."""

from collections.abc import Mapping, Sequence
from functools import reduce
from math import isfinite
from numbers import Real
from operator import and_
from typing import Any, Literal, get_args

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from pytensor.graph.basic import Constant, Variable
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import (
    GEOMETRY,
    check_inflation_data,
    describe_test,
)
from pymc_hyperelastic.mechanics.axial_force import wall_force
from pymc_hyperelastic.mechanics.collocation import (
    CollocatedAxialForce,
    CollocatedPressureIntegral,
    collocate,
)
from pymc_hyperelastic.mechanics.inversion import RadiusAtPressure
from pymc_hyperelastic.mechanics.layers import Layer, check_energy
from pymc_hyperelastic.mechanics.pressure import wall_pressure
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.models.rules import (
    CurrentTube,
    Mode,
    Rule,
    current_tube,
    rule_for,
    tube_inputs,
)
from pymc_hyperelastic.models.slopes import (
    central_differences,
    compressed_spectrum,
    half_log_determinant,
    measured_slopes,
)

__all__ = [
    "check_likelihood",
    "inflation_likelihood",
    "likelihood_inputs",
    "log_likelihood",
    "register_likelihood",
    "shared_inputs",
]

ErrorIn = Literal["pressure", "radius"]

# Of the radius: where the last step towards that at a pressure is longer, none was found.
_LARGEST_LAST_STEP = 1e-6
# kPa², or (kPa/mm)²: far beyond any tube; what is made of smaller numbers does not overflow.
_LARGEST_MISFIT = np.float64(1e60)
# kPa/mm: its square is beyond that.
OVERFLOW = np.float64(1e60)


def inflation_likelihood(
    name: str,
    energy: StrainEnergy,
    data: xr.Dataset,
    parameters: dict[str, Any],
    *,
    sigma: Any,
    slope_weight: Any,
    force_sigma: Any = None,
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

    With `force_sigma`, measured axial forces add ``−|ΔF|²/σ_F² − (N_F/2) ln(π σ_F²)``.

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
    sigma : tensor_like
        The paper's ``σ``, kPa, or mm if the error is in the radius; a number or a random variable.
    slope_weight : tensor_like
        The paper's ``β``, mm²; a number or a random variable. With the number 0 slopes play no
        part. See :func:`~pymc_hyperelastic.balanced_slope_weight`.
    force_sigma : tensor_like, optional
        The same as `sigma` for axial forces, mN; without it they play no part.
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
        If the parameters are not those of the strain energy, something is not a scalar, or no
        model is in context.
    ValueError
        If the name is taken, `sigma` or `slope_weight` is an impossible number, or a test has too
        few points or repeated radii for a slope.

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
    noise = {"sigma": sigma, "slope_weight": slope_weight, "force_sigma": force_sigma}
    check_energy(energy)
    check_likelihood(energy, data, parameters, geometry=geometry, error_in=error_in, **noise)
    sizes = {p.name: p.size for p in energy.parameters}
    parameters = {key: _as_tensor(key, value, sizes[key]) for key, value in parameters.items()}
    geometry = {key: _as_tensor(key, value) for key, value in (geometry or {}).items()}
    with_force = force_sigma is not None
    rule = rule_for(
        energy,
        data,
        parameters,
        geometry,
        mode=mode,
        with_force=with_force,
        known_radii=error_in == "pressure",
    )
    settings = {"geometry": geometry, "error_in": error_in, **noise}
    return register_likelihood(name, energy, data, rule, parameters, **settings)


def register_likelihood(
    name: str,
    energy: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    rule: Rule,
    parameters: dict[str, Any],
    *,
    geometry: Mapping[str, Any] | None = None,
    error_in: ErrorIn = "pressure",
    **noise: Any,
) -> TensorVariable:
    """Add the likelihood of checked input."""
    with_force = noise.get("force_sigma") is not None
    arrays = likelihood_inputs(
        data, rule, slope_weight=noise["slope_weight"], with_force=with_force
    )
    inputs = shared_inputs(name, arrays)
    settings = {"geometry": geometry, "error_in": error_in, **noise}
    expression = log_likelihood(energy, inputs, rule, parameters, **settings)
    return pm.Potential(name, expression)


def likelihood_inputs(
    data: xr.Dataset, rule: Rule, *, slope_weight: Any, with_force: bool = False
) -> dict[str, np.ndarray]:
    """Arrays by which the data enter :func:`log_likelihood`.

    They are kept apart from its expression, so that one compiled expression serves all data.
    """
    inputs = {"points": np.array(float(data.sizes["obs"]))}
    targets = {"pressure": data["pressure"].values.astype(float)}
    if with_slopes(slope_weight):
        targets["slope"] = np.full(data.sizes["obs"], np.nan)
        targets["slope"][central_differences(data)[0]] = measured_slopes(data)
        if isinstance(slope_weight, Variable):
            inputs["eigenvalues"], inputs["multiplicities"] = compressed_spectrum(data)
        else:
            inputs["half_log_determinant"] = np.array(half_log_determinant(data, slope_weight))
    if with_force:
        targets["force"] = data["axial_force"].values.astype(float)
        inputs["forces"] = np.array(float(np.isfinite(targets["force"]).sum()))
    if rule.method == "collocation":
        return inputs | collocate(data, rule.nodes, targets)
    inputs |= tube_inputs(data)
    for name, target in targets.items():
        rows = np.flatnonzero(np.isfinite(target))
        inputs |= {f"{name}_rows": rows, f"{name}_target": target[rows]}
    return inputs


def shared_inputs(name: str, inputs: dict[str, np.ndarray]) -> dict[str, Variable]:
    """Shared variables of these arrays, which arrays of other lengths may replace."""
    return {
        key: pytensor.shared(value, name=f"{name}_{key}", shape=(None,) * value.ndim)
        for key, value in inputs.items()
    }


def log_likelihood(
    energy: StrainEnergy | Sequence[Layer],
    inputs: dict[str, Any],
    rule: Rule,
    parameters: dict[str, Any],
    *,
    sigma: Any,
    slope_weight: Any,
    force_sigma: Any = None,
    error_in: ErrorIn = "pressure",
    geometry: Mapping[str, Any] | None = None,
) -> TensorVariable:
    """Log-likelihood of :func:`inflation_likelihood` as an expression of arrays and parameters."""
    with_force = force_sigma is not None
    conditions: list[TensorVariable]
    if rule.method == "collocation" and isinstance(energy, StrainEnergy):
        entries = energy.split(parameters)
        conditions, response = [], _collocated(energy, inputs, entries, with_force)
    else:
        current = current_tube(energy, inputs, geometry or {}, parameters)
        layered = not isinstance(energy, StrainEnergy)
        conditions = [current.possible] if geometry or layered else []
        if error_in == "radius":
            found, error = _error_in_radius(current, inputs["pressure_target"], rule.nodes)
            conditions.append(found)
            inputs = inputs | {"pressure_target": 0.0}
            response = {"pressure": error}
        else:
            response = _direct(current, inputs, rule.nodes)
        if with_force:
            response["force"] = wall_force(current.tubes, rule.nodes)[inputs["force_rows"]]

    def misfit(name: str) -> TensorVariable:
        total = pt.sum(pt.square(response[name] - inputs[f"{name}_target"]))
        conditions.append(total < _LARGEST_MISFIT)
        # Else a noise parameter's gradient would be 0 * inf. That of the material is zero by the
        # integral itself.
        return pt.where(conditions[-1], total, 0.0) + inputs.get(f"{name}_residual", 0.0)

    log_density = -inputs["points"] / 2 * pt.log(np.pi * pt.square(sigma))
    log_density -= misfit("pressure") / pt.square(sigma)
    if with_slopes(slope_weight):
        log_density -= slope_weight * misfit("slope") / pt.square(sigma)
        if isinstance(slope_weight, Variable):
            logs = pt.log1p(slope_weight * inputs["eigenvalues"])
            log_density += pt.sum(inputs["multiplicities"] * logs) / 2
        else:
            log_density += inputs["half_log_determinant"]
    if with_force:
        log_density -= inputs["forces"] / 2 * pt.log(np.pi * pt.square(force_sigma))
        log_density -= misfit("force") / pt.square(force_sigma)
    return pt.where(reduce(and_, conditions), log_density, -np.inf)


def _collocated(
    energy: StrainEnergy, inputs: dict[str, Any], entries: list[Any], with_force: bool
) -> dict[str, TensorVariable]:
    """Compressed pressures, slopes and forces of known tubes."""
    stretches = inputs["log_hoop"], inputs["log_axial"]
    # Without slopes, as many rows of nothing.
    slope_matrix = inputs.get("slope_matrix", inputs["pressure_matrix"][:, :0])
    pressure, slope = CollocatedPressureIntegral(strain_energy=energy)(
        *stretches, inputs["pressure_matrix"], slope_matrix, *entries
    )
    response = {"pressure": pressure, "slope": slope}
    if with_force:
        force = CollocatedAxialForce(strain_energy=energy)
        response["force"] = force(*stretches, inputs["force_matrix"], *entries)
    return response


def _direct(current: CurrentTube, inputs: dict[str, Any], order: int) -> dict[str, TensorVariable]:
    """Pressures, and slopes where they were measured."""
    pressure, stiffness = wall_pressure(current.tubes, order)
    response = {"pressure": pressure}
    if "slope_rows" in inputs:
        # Where it overflows, the gradient by the growth would be 0 * inf.
        stiffness = pt.where(pt.isfinite(stiffness), stiffness, OVERFLOW)
        response["slope"] = (stiffness * current.growth)[inputs["slope_rows"]]
    return response


def _error_in_radius(
    current: CurrentTube, pressure: Any, order: int
) -> tuple[TensorVariable, TensorVariable]:
    """Whether there are radii of the measured pressures, and their distance from the measured."""
    energies, inputs = [], []
    for tube in current.tubes:
        _, inner_radius, outer_radius, *_ = tube.geometry
        energies.append(tube.energy)
        inputs += [outer_radius - inner_radius, *tube.entries]
    _, inner_radius, _, *reference = current.tubes[0].geometry
    op = RadiusAtPressure(strain_energies=tuple(energies), order=order)
    radius, last_step = op(pressure, current.radius, inner_radius, *reference, *inputs)
    found = last_step < _LARGEST_LAST_STEP
    radius = pt.where(found, radius, current.radius)
    return pt.all(found), current.measured(radius) - current.measured(current.radius)


def check_likelihood(
    energy: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    parameters: Mapping[str, Any],
    *,
    geometry: Mapping[str, Any] | None = None,
    sigma: Any,
    slope_weight: Any,
    force_sigma: Any = None,
    error_in: ErrorIn = "pressure",
) -> None:
    """Raise unless the likelihood of `data` can be written down."""
    if isinstance(energy, StrainEnergy):
        if not isinstance(parameters, Mapping):
            raise TypeError(
                f"parameters must be a dict with the keys {list(energy.parameter_names)}, not "
                f"{type(parameters).__name__}"
            )
        energy.split(parameters)
    check_inflation_data(data)
    if geometry is not None and not isinstance(geometry, Mapping):
        raise TypeError(
            f"geometry must be a dict with keys of {GEOMETRY}, not {type(geometry).__name__}"
        )
    strangers = [name for name in geometry or {} if name not in GEOMETRY]
    if strangers:
        raise ValueError(f"geometry holds {strangers[0]!r}; it may hold {GEOMETRY}")
    needed = set(GEOMETRY) - set(geometry or {})
    if not isinstance(energy, StrainEnergy):
        needed.discard("outer_radius")
        if "outer_radius" in (geometry or {}) or not data["outer_radius"].isnull().all():
            raise ValueError(
                "layers state the thickness of the wall, and the data its outer radius: leave that "
                "away, ph.inflation_data(..., outer_radius=None)"
            )
    for name in sorted(needed):
        unknown = np.flatnonzero(data[name].isnull().values)
        if unknown.size:
            raise ValueError(
                f"{describe_test(data, int(unknown[0]))}: {name} is not known: give it a prior, "
                f"geometry={{{name!r}: ...}}"
            )
    expected = {
        "sigma": "a positive number of kPa (5 mmHg is 5 * ph.mmHg)",
        "slope_weight": "a number of mm², 0 to leave the slopes out",
        "force_sigma": "a positive number of mN",
    }
    noise = {"sigma": sigma, "slope_weight": slope_weight, "force_sigma": force_sigma}
    for name, value in noise.items():
        if name == "force_sigma" and value is None:
            continue
        if isinstance(value, Variable):
            if value.type.ndim:
                raise TypeError(
                    f"{name} has {value.type.ndim} dimension(s); expected {expected[name]}, or a "
                    "scalar distribution"
                )
            continue
        if isinstance(value, bool) or not isinstance(value, Real):
            raise TypeError(f"{name} is {value!r}; expected {expected[name]}, or a distribution")
        if not isfinite(value) or value < 0 or (name != "slope_weight" and value == 0):
            raise ValueError(f"{name} is {value}; expected {expected[name]}")
    if force_sigma is not None and (
        "axial_force" not in data or data["axial_force"].isnull().all()
    ):
        raise ValueError(
            "force_sigma is given, but the data hold no axial forces: add a column 'axial_force'"
        )
    if error_in not in get_args(ErrorIn):
        raise ValueError(f"error_in is {error_in!r}; expected one of {get_args(ErrorIn)}")
    if error_in == "radius" and with_slopes(slope_weight):
        raise ValueError(
            f"slope_weight is {slope_weight}, but with error_in='radius' slopes play no part: "
            "expected 0"
        )
    if with_slopes(slope_weight):
        central_differences(data)


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


def with_slopes(slope_weight: Any) -> bool:
    """Whether slopes play a part."""
    return isinstance(slope_weight, Variable) or slope_weight != 0
