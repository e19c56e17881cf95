"""Stresses of a flat sheet that is stretched along its two axes, and its free lateral stretch."""

from collections.abc import Iterable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import pytensor.tensor as pt
from pytensor import scan
from pytensor.graph.basic import Variable
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.integrals import SMALLEST_STEP
from pymc_hyperelastic.mechanics.layers import check_energy, check_geometry, double
from pymc_hyperelastic.mechanics.strain_energy.base import (
    IsotropicStrainEnergy,
    StrainEnergy,
    elementwise_derivative,
)
from pymc_hyperelastic.mechanics.wall import TubeOp

Axis = Literal["x", "y"]

# Steps of Newton's method: ten reach a stretch that is 150 times smaller, and six converge.
_STEPS = 16
# Longest step of the logarithm of a stretch: the first sheet whose stress has the other sign is
# then near the solution.
_LONGEST_STEP = 0.5


class SheetStress(NamedTuple):
    """Stresses of a sheet along its axes, kPa; that of a free direction is 0."""

    x: Tensor
    y: Tensor


def sheet_stress(
    energy: StrainEnergy,
    stretch_x: Any,
    stretch_y: Any = None,
    *,
    nominal: bool = False,
    **parameters: Any,
) -> SheetStress:
    r"""Stresses of a thin incompressible sheet under given stretches along its axes.

    The faces of the sheet are free. With ``Ŵ(λx, λy) = W(1/(λx λy), λx, λy)``,

    .. math:: σ_x = λ_x \frac{∂\hat W}{∂λ_x}, \qquad σ_y = λ_y \frac{∂\hat W}{∂λ_y}, \qquad
        P_x = \frac{σ_x}{λ_x}, \qquad P_y = \frac{σ_y}{λ_y}

    are the Cauchy stresses, and the nominal stresses: forces per area of the unloaded cross-section
    (first Piola-Kirchhoff). The x axis takes the place of the hoop direction of a tube, and the y
    axis that of its axial direction. An angle of fibres is therefore measured from x.

    The usual tests of sheets are

    ============================  ==================================================
    planar biaxial                both stretches
    equibiaxial                   two equal stretches
    pure shear (planar tension)   one stretch, and 1 for the other
    uniaxial, along x or y        one stretch; the other is None, and follows from
                                  :func:`free_stretch`
    ============================  ==================================================

    Simple shear rotates the principal stretches away from the axes. The energies of this package
    are functions of the stretches along the axes, so that it is not among these tests.

    Parameters
    ----------
    energy : StrainEnergy
        The material, such as ``ph.MooneyRivlin()``.
    stretch_x, stretch_y : tensor_like or None
        Stretches along the axes: deformed length over unloaded length. None stands for a direction
        in which the sheet is free.
    nominal : bool, default False
        Whether nominal stresses are returned in place of Cauchy stresses.
    **parameters : tensor_like
        The material parameters by name; moduli in kPa. Arguments may be numbers, arrays or random
        variables; they broadcast against each other.

    Returns
    -------
    SheetStress
        Stresses ``x`` and ``y`` in kPa, in the broadcast shape. NaN if no lateral stretch is found
        at which the free direction has no stress.

    Raises
    ------
    TypeError
        If `energy` is no strain energy, a parameter is missing or unknown, or both stretches are
        None.
    ValueError
        If a stretch is not a positive number.

    See Also
    --------
    free_stretch, inflation_pressure

    References
    ----------
    G. A. Holzapfel, Nonlinear Solid Mechanics, Wiley 2000, chapter 6.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> law = ph.NeoHookean()
    >>> biaxial = ph.sheet_stress(law, 1.5, 1.2, mu=30.0)  # σx = 30 (λx² − 1/(λx λy)²)
    >>> round(float(biaxial.x.eval()), 3)
    58.241
    >>> uniaxial = ph.sheet_stress(law, [1.5, 2.0], nominal=True, mu=30.0)  # P = 30 (λ − 1/λ²)
    >>> uniaxial.x.eval().round(3)
    array([31.667, 52.5  ])
    """
    check_energy(energy)
    if stretch_x is None and stretch_y is None:
        raise TypeError(
            "both stretches are None: give stretch_x, stretch_y or both; None stands for a "
            "direction in which the sheet is free"
        )
    check_geometry(stretch_x=stretch_x, stretch_y=stretch_y)
    entries = [double(entry) for entry in energy.split(parameters)]
    stress_x, stress_y, log_x, log_y = stresses_at(
        energy, _log(stretch_x), _log(stretch_y), entries
    )
    if nominal:
        stress_x, stress_y = stress_x * pt.exp(-log_x), stress_y * pt.exp(-log_y)
    return SheetStress(stress_x, stress_y)


def stresses_at(
    energy: StrainEnergy, log_x: Any, log_y: Any, entries: Sequence[Any]
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return the Cauchy stresses along x and y, and the logarithms of both stretches.

    One of the logarithms may be None, for a direction in which the sheet is free.
    """
    free_x, free_y = log_x is None, log_y is None
    if free_y:
        log_y = _log_free_stretch(energy, log_x, entries, "x")
    elif free_x:
        log_x = _log_free_stretch(energy, log_y, entries, "y")
    log_x, log_y, *entries = pt.broadcast_arrays(log_x, log_y, *entries)
    parameters = energy.join(entries)
    x = energy.stress_difference(log_x, log_y, **parameters)
    y = energy.axial_stress_difference(log_x, log_y, **parameters)
    # If no lateral stretch was found, the other stress is NaN.
    return pt.zeros_like(y) if free_x else x, pt.zeros_like(x) if free_y else y, log_x, log_y


def free_stretch(
    energy: StrainEnergy, stretch: Any, *, along: Axis = "x", **parameters: Any
) -> Tensor:
    r"""Lateral stretch of a sheet that is stretched along one axis and free along the other.

    It is the stretch ``λy`` at which the lateral stress is zero,

    .. math:: σ_y(λ_x, λ_y) = 0,

    or ``λx`` for a sheet that is stretched along y. In an isotropic sheet it is ``λx^{−1/2}``. In
    others it is found by Newton's method; its gradient is that of the exact solution.

    Parameters
    ----------
    energy : StrainEnergy
        The material.
    stretch : tensor_like
        Stretch along the axis that is pulled.
    along : {"x", "y"}
        The axis that is pulled.
    **parameters : tensor_like
        The material parameters by name; moduli in kPa. They broadcast against the stretch.

    Returns
    -------
    TensorVariable
        The lateral stretch, in the broadcast shape. NaN if none is found.

    Raises
    ------
    TypeError
        If `energy` is no strain energy, or a parameter is missing or unknown.
    ValueError
        If a stretch is not a positive number, or there is no such axis.

    See Also
    --------
    sheet_stress

    Examples
    --------
    Fibres at 30 degrees from the x axis contract the sheet further if it is pulled along x. If it
    is pulled along y they are slack, and the lateral stretch is that of the isotropic matrix:

    >>> import pymc_hyperelastic as ph
    >>> law, parameters = ph.HolzapfelGasserOgden(), {"c": 10.0, "k1": 20.0, "k2": 1.0}
    >>> along_x = ph.free_stretch(law, 1.3, beta=30.0, **parameters)
    >>> along_y = ph.free_stretch(law, 1.3, along="y", beta=30.0, **parameters)
    >>> round(float(along_x.eval()), 3), round(float(along_y.eval()), 3), round(1.3**-0.5, 3)
    (0.742, 0.877, 0.877)
    """
    check_energy(energy)
    check_geometry(stretch=stretch)
    if along not in ("x", "y"):
        raise ValueError(f"along is {along!r}; expected 'x' or 'y'")
    entries = [double(entry) for entry in energy.split(parameters)]
    return pt.exp(_log_free_stretch(energy, _log(stretch), entries, along))


class LogFreeStretch(TubeOp):
    r"""Logarithm ``y`` of the lateral stretch without lateral stress ``S``, at a given ``x``.

    Newton's method from the stretch of an isotropic sheet. Until the sign of the stress changes,
    its steps are those for ``asinh(S/S₀) = 0``, where ``S₀`` is the slope ``∂S/∂y`` of the
    unloaded sheet, because stress may grow exponentially. Then the sheets on both sides enclose the
    solution, and a step that leaves this interval is replaced by its middle. The gradient is that
    of the exact solution,

    .. math:: \frac{∂y}{∂q} = -\frac{∂S}{∂q} \Big/ \frac{∂S}{∂y} .

    Inputs are the logarithm ``x`` of the stretch along the axis `along`, then the parameters in the
    order of the strain energy; they broadcast against each other. Outputs are ``y``, and the length
    of the last step, which is large where no such stretch was found.
    """

    __props__ = ("strain_energy", "along")

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Take all steps of Newton's method, from the stretch of an isotropic sheet."""
        log_stretch, *entries = pt.broadcast_arrays(*inputs)
        unloaded, unloaded_lateral = pt.zeros_like(log_stretch), pt.zeros_like(log_stretch)
        scale = elementwise_derivative(
            self._stress(unloaded, unloaded_lateral, entries), unloaded_lateral
        )
        start = -log_stretch / 2
        interval = pt.zeros_like(start) - np.inf, pt.zeros_like(start) + np.inf
        # A loop in place of a graph of all steps, which would take minutes to compile.
        lateral, _, _, last_step = scan(
            self._step,
            outputs_info=[start, *interval, pt.zeros_like(start)],
            non_sequences=[log_stretch, scale, *entries],
            n_steps=_STEPS,
            return_updates=False,
            strict=True,
        )
        return [lateral[-1], pt.abs(last_step[-1])]

    def _step(
        self, lateral: Tensor, low: Tensor, high: Tensor, _: Tensor, *given: Tensor
    ) -> list[Tensor]:
        """Take a step of Newton's method: return the stretch, its interval, and the step."""
        log_stretch, scale, *entries = given
        stress = self._stress(log_stretch, lateral, entries)
        slope = elementwise_derivative(stress, lateral)
        low, high = pt.where(stress < 0, lateral, low), pt.where(stress > 0, lateral, high)
        by_log = pt.arcsinh(stress / scale) * pt.sqrt(stress**2 + scale**2)
        step = -pt.where(pt.isinf(high - low), by_log, stress) / slope
        # A step that is not a number has overflowed: stress is then enormous.
        step = pt.where(pt.isnan(step), -pt.sign(stress), step)
        newton = lateral + pt.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
        inside = (low < newton) & (newton < high)
        moved = pt.where(inside | pt.isinf(high - low), newton, (low + high) / 2)
        return [moved, low, high, moved - lateral]

    def known_gradients(self, inputs: Any, outputs: Any, cotangents: Any) -> Iterable[tuple]:
        """Gradient of the exact solution; the last step has none."""
        log_stretch, *entries = pt.broadcast_arrays(*inputs)
        stress = self._stress(log_stretch, outputs[0], entries)
        slope = elementwise_derivative(stress, outputs[0])
        return [(-stress, cotangents[0] / slope)]

    def _stress(self, log_stretch: Tensor, lateral: Tensor, entries: Any) -> Tensor:
        """Lateral stress, kPa."""
        parameters = self.strain_energy.join(entries)
        if self.along == "x":
            return self.strain_energy.axial_stress_difference(log_stretch, lateral, **parameters)
        return self.strain_energy.stress_difference(lateral, log_stretch, **parameters)


def _log_free_stretch(energy: StrainEnergy, log_stretch: Any, entries: Any, along: Axis) -> Tensor:
    if isinstance(energy, IsotropicStrainEnergy):
        return -log_stretch / 2
    op = LogFreeStretch(strain_energy=energy, along=along)
    lateral, last_step = op(log_stretch, *entries)
    return pt.where(last_step < SMALLEST_STEP, lateral, np.nan)


def _log(stretch: Any) -> Any:
    """Logarithm of a stretch, or None."""
    return None if stretch is None else pt.log(pt.as_tensor(double(stretch)))
