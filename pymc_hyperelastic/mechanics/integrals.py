"""The integrals over a wall: pressure, axial force, stored energy; and the pressure inverted."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pytensor.tensor as pt
from pytensor.graph.basic import Variable
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.layers import LayeredTube
from pymc_hyperelastic.mechanics.strain_energy.base import elementwise_derivative
from pymc_hyperelastic.mechanics.wall import WALL_ORDER, TubeOp, WallIntegral, response

# Longest step of Newton's method, relative to the radius: none leaps over a maximum of the pressure
# and the minimum beyond it.
LONGEST_STEP = 0.1
# Step of Newton's method, relative to a radius or a stretch, with which a solution counts as found:
# Newton's method squares its error, so that the next step is below rounding.
SMALLEST_STEP = 1e-9


class PressureIntegral(WallIntegral):
    r"""Pressure of an inflated tube, and its derivative by the internal radius.

    With the wall coordinate ``s = ln R`` and the elongation ``δ`` of
    :func:`~pymc_hyperelastic.mechanics.tube.hoop_elongation`

    .. math::

        p(a) &= \int_{\ln A}^{\ln B} \frac{T}{1 + δ} \, ds, \qquad
        T = \frac{∂\hat W}{∂\ln λ_θ} = σ_{θθ} - σ_{rr}, \\
        \frac{dp}{da} &= \int_{\ln A}^{\ln B}
            \left(\frac12 \frac{∂T}{∂\ln λ_θ} - T\right)
            \frac{2 k λ_z a}{R^2 (1 + δ)^2} \, ds,

    which is ``p = ∫ (∂Ŵ/∂λθ)/(λz r) dR`` in other variables.

    Inputs are internal radius ``a``, inner radius ``A``, outer radius ``B`` (mm), axial stretch,
    opening angle (rad), then the parameters in the order of the strain energy, vectors entry by
    entry; they broadcast against each other. Outputs are pressure (kPa) and stiffness (kPa/mm) in
    the broadcast shape.

    Attributes
    ----------
    strain_energy : StrainEnergy
        The material.
    order : int, default 32
        Nodes of the Gauss-Legendre rule, on each piece of a wall that is split where fibres
        slacken. Wherever ``B/A ≤ 2.5``, ``0.8 ≤ λz ≤ 1.9``, ``Φ ≤ 160°`` and
        ``0.6 A ≤ a ≤ 1.7 A``, over the default priors' range of parameters, 32 nodes agree with
        200 to a relative 1e-10, and to 1e-12 for ``a ≥ A``; for laws with the exponential of a
        square, as long as pressure stays below a thousand moduli.

    See Also
    --------
    inflation_pressure

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> integral = ph.PressureIntegral(strain_energy=ph.NeoHookean())
    >>> pressure, stiffness = integral(8.0, 7.0, 9.0, 1.0, 0.0, 30.0)
    >>> round(float(pressure.eval()), 3), round(float(stiffness.eval()), 3)
    (2.629, 2.012)
    """

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Gauss-Legendre quadrature over a last axis, which the sums remove."""
        rule, log_axial, entries = self.rule(inputs)
        stress = response(self.strain_energy, rule.log_hoop, log_axial, entries)
        slope = elementwise_derivative(stress, rule.log_hoop)
        return [
            (rule.pressure_weight * stress).sum(axis=-1),
            (rule.stiffness_weight * (slope / 2 - stress)).sum(axis=-1),
        ]


class AxialForceIntegral(WallIntegral):
    r"""Reduced axial force of an inflated tube, and its derivative by the internal radius.

    .. math::

        F(a) &= \frac{π}{k λ_z} \int_{\ln A}^{\ln B} G R^2 \, d(\ln R), \qquad
        G = 2 (σ_{zz} - σ_{rr}) - (σ_{θθ} - σ_{rr}), \\
        \frac{∂F}{∂a} &= π a \int_{\ln A}^{\ln B}
            \frac{1}{1 + δ} \frac{∂G}{∂\ln λ_θ} \, d(\ln R) .

    ``F`` is the axial force in the wall less ``π a² p``, the force of the pressure on closed ends:
    a force transducer at an end measures it. Inputs and attributes are those of
    :class:`PressureIntegral`; the outputs are in mN (kPa mm²) and mN/mm.
    """

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Gauss-Legendre quadrature over the last axis, which the sums remove."""
        rule, log_axial, entries = self.rule(inputs)
        stress = response(self.strain_energy, rule.log_hoop, log_axial, entries, force=True)
        slope = elementwise_derivative(stress, rule.log_hoop)
        return [
            (rule.force_weight * stress).sum(axis=-1),
            np.pi * inputs[0] * (rule.pressure_weight * slope).sum(axis=-1),
        ]


class MaterialIntegral(WallIntegral):
    r"""Stored energy and two incremental moduli, integrated over the current area of the wall.

    .. math:: \int_a^b w \, 2π r \, dr = \frac{2π}{k λ_z} \int_{\ln A}^{\ln B} w R^2 \, d(\ln R)

    The integrand ``w`` is, in turn, the energy ``Ŵ`` per unit of volume less that of the
    stress-free state, and the moduli of small strains superposed on the inflated state,

    .. math::

        C_θ = \frac{∂^2 \hat W}{∂(\ln λ_θ)^2} = \frac{∂(σ_{θθ} - σ_{rr})}{∂\ln λ_θ}, \qquad
        C_z = \frac{∂^2 \hat W}{∂(\ln λ_z)^2} = \frac{∂(σ_{zz} - σ_{rr})}{∂\ln λ_z} .

    Inputs and attributes are those of :class:`PressureIntegral`. The three outputs are in mN
    (kPa mm²); divided by the area of the wall, ``π (B² − A²)/(k λz)``, they are means in kPa.
    """

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Gauss-Legendre quadrature over the last axis, which the sums remove."""
        rule, log_axial, entries = self.rule(inputs)
        energy, parameters = self.strain_energy, self.strain_energy.join(entries)
        # The derivatives are elementwise, so that each node needs its own axial stretch.
        log_hoop, log_axial = rule.log_hoop, log_axial + pt.zeros_like(rule.log_hoop)
        rest = pt.zeros_like(log_hoop)
        stored = energy.reduced_energy(log_hoop, log_axial, **parameters)
        stored -= energy.reduced_energy(rest, rest, **parameters)
        hoop = energy.stress_difference(log_hoop, log_axial, **parameters)
        axial = energy.axial_stress_difference(log_hoop, log_axial, **parameters)
        moduli = elementwise_derivative(hoop, log_hoop), elementwise_derivative(axial, log_axial)
        return [2 * (rule.force_weight * w).sum(axis=-1) for w in (stored, *moduli)]


def wall_pressure(tube: LayeredTube, radius: Any, order: int = WALL_ORDER) -> tuple[Tensor, Tensor]:
    """Pressure (kPa) and stiffness (kPa/mm) of a tube at internal radii."""
    return _with_slope(PressureIntegral, tube, radius, order)


def wall_force(tube: LayeredTube, radius: Any, order: int = WALL_ORDER) -> tuple[Tensor, Tensor]:
    """Axial force (mN) of a tube at internal radii, and its slope (mN/mm)."""
    return _with_slope(AxialForceIntegral, tube, radius, order)


def wall_material(tube: LayeredTube, radius: Any, order: int = WALL_ORDER) -> list[Tensor]:
    """Stored energy and moduli of a tube at internal radii, see :class:`MaterialIntegral`."""
    of_layers = [outputs for outputs, _ in _of_layers(MaterialIntegral, tube, radius, order)]
    return [sum(values) for values in zip(*of_layers, strict=True)]


def _with_slope(
    kind: type[WallIntegral], tube: LayeredTube, radius: Any, order: int
) -> tuple[Tensor, Tensor]:
    """Add up an integral and its slope by the internal radius over the layers."""
    value, slope = 0.0, 0.0
    for (own_value, own_slope), own_radius in _of_layers(kind, tube, radius, order):
        value += own_value
        # Incompressibility: the internal radius a' of a layer satisfies da'/da = a/a'.
        slope += own_slope if own_radius is radius else own_slope * radius / own_radius
    return value, slope


def _of_layers(
    kind: type[WallIntegral], tube: LayeredTube, radius: Any, order: int
) -> Iterator[tuple[Any, Any]]:
    """Yield the outputs of an integral over each layer, and the internal radius of the layer."""
    axial_stretch, opening_angle = tube.geometry["axial_stretch"], tube.geometry["opening_angle"]
    for layer in tube.layers:
        innermost = layer is tube.layers[0]
        own_radius = radius if innermost else tube.current(layer.inner_radius, radius)
        geometry = own_radius, layer.inner_radius, layer.outer_radius, axial_stretch, opening_angle
        op = kind(strain_energy=layer.energy, order=order)
        yield op(*geometry, *layer.entries), own_radius


class RadiusAtPressure(TubeOp):
    r"""Internal radius at which a tube has a given pressure.

    Newton's method from a radius next to it, in steps of a tenth of the radius at most. The
    gradient is that of the exact solution,

    .. math:: \frac{∂a}{∂p} = \frac{1}{s}, \qquad \frac{∂a}{∂x} = -\frac{1}{s} \frac{∂p}{∂x}

    with the stiffness ``s = ∂p/∂a``. Inputs are the pressure (kPa), the radius to start from, and
    :attr:`LayeredTube.inputs`; they broadcast against each other. Outputs are the radius, and the
    relative length of the last step, which is large where no such radius was found. Both are
    infinite where pressure falls with the radius. `strain_energies` are those of the layers,
    `order` is the number of nodes of the Gauss-Legendre rule.
    """

    __props__ = ("strain_energies", "order")

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Take all steps of Newton's method."""
        pressure, radius, *rest = inputs
        tube = LayeredTube.of_inputs(self.strain_energies, rest)
        # The longest steps reach twice the first radius; fewer are needed to converge.
        for _ in range(round(1 / LONGEST_STEP)):
            here, stiffness = wall_pressure(tube, radius, self.order)
            step = pt.where(stiffness > 0, (pressure - here) / (stiffness * radius), np.inf)
            radius = radius * (1 + pt.clip(step, -LONGEST_STEP, LONGEST_STEP))
        return [pt.where(pt.isinf(step), np.inf, radius), pt.abs(step)]

    def known_gradients(self, inputs: Any, outputs: Any, cotangents: Any) -> Iterable[tuple]:
        """Gradient of the exact solution; the last step has none."""
        pressure, _, *rest = inputs
        tube = LayeredTube.of_inputs(self.strain_energies, rest)
        here, stiffness = wall_pressure(tube, outputs[0], self.order)
        return [(pressure - here, cotangents[0] / stiffness)]

    def pullback(self, inputs: Any, outputs: Any, cotangents: Any) -> list[Variable]:
        """Gradient by every input; that by the radius to start from is 0."""
        gradients = super().pullback(inputs, outputs, cotangents)
        return [gradients[0], pt.zeros_like(inputs[1]), *gradients[2:]]
