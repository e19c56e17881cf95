"""Pressure and stiffness of an inflated thick-walled tube: one Op for every strain energy."""

from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytensor.tensor as pt
from pytensor.compile.inner_function import link_only_mode
from pytensor.compile.mode import Mode
from pytensor.gradient import DisconnectedType, grad
from pytensor.graph.basic import Apply, Variable
from pytensor.graph.op import Op
from pytensor.graph.replace import _vectorize_node, clone_replace
from pytensor.tensor.symbolic import TensorSymbolicOp
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.mechanics.layers import Layer, Tube, check_energy, tubes_of
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy, elementwise_derivative
from pymc_hyperelastic.mechanics.tube import hoop_elongation, opening_factor

__all__ = [
    "PressureIntegral",
    "TubeOp",
    "WallIntegral",
    "broadcast_batches",
    "check_geometry",
    "checked_tubes",
    "finite_or_zero",
    "inflation_pressure",
    "inflation_stiffness",
    "wall_pressure",
    "wall_rule",
]


class TubeOp(TensorSymbolicOp):
    """What the integrals over the wall have in common: a strain energy, and a tame gradient."""

    # Inlined when compiled, value and gradient share their common terms: two to four times faster.
    inline = True

    def __init__(
        self, input_types: Any = None, *, strain_energy: StrainEnergy, **settings: Any
    ) -> None:
        check_energy(strain_energy)
        settings.setdefault("name", f"{type(self).__name__}[{strain_energy!r}]")
        super().__init__(input_types, strain_energy=strain_energy, **settings)

    @staticmethod
    def filter_inputs(*inputs: Any) -> tuple[TensorVariable, ...]:
        """Inputs in double precision: PyTensor reads the number 7.0 as a single-precision one."""
        return tuple(pt.cast(pt.as_tensor_variable(x), "float64") for x in inputs)

    def pullback(self, inputs: Any, outputs: Any, cotangents: Any) -> list[Variable]:
        """Gradient by every input: the same rule, differentiated under the integral.

        Where pressure overflows no gradient exists. Zero is returned there, so that a likelihood
        that rejects such pressures has the gradient zero and not NaN.
        """
        # Variables of their own keep inputs apart that depend on each other.
        own = [x.type() for x in inputs]
        known = {
            output: cotangent
            for output, cotangent in zip(self.build_inner_graph(*own), cotangents, strict=True)
            if not isinstance(cotangent.type, DisconnectedType)
        }
        gradients = grad(
            None,
            own,
            known_grads=known,
            disconnected_inputs="ignore",
            return_disconnected="disconnected",
        )
        gradients = clone_replace(gradients, dict(zip(own, inputs, strict=True)))
        return finite_or_zero(gradients)

    def link_mode(self, impl: str | None) -> Mode:
        """Python for Python: PyMC asks for shapes in this way, and needs no compiler for it."""
        return link_only_mode("py") if impl == "py" else super().link_mode(impl)

    def response(
        self, log_hoop: TensorVariable, log_axial: TensorVariable, entries: Sequence[Any]
    ) -> TensorVariable:
        """What the integral is linear in: the stress difference ``T`` of the material."""
        parameters = self.strain_energy.join(entries)
        return self.strain_energy.stress_difference(log_hoop, log_axial, **parameters)


def finite_or_zero(gradients: Sequence[Variable]) -> list[Variable]:
    """Gradients with 0 in place of what is not finite; those that are disconnected stay."""
    return [
        pt.where(pt.isfinite(g), g, 0.0) if isinstance(g, TensorVariable) else g for g in gradients
    ]


class WallRule(NamedTuple):
    """Quadrature of a wall, over the last axis: where, and weights of what is integrated.

    Pressure is the weighted sum of ``T``, stiffness that of ``½ ∂T/∂ln λθ − T``, and axial force
    that of ``2 (σzz − σrr) − T``.
    """

    log_hoop: Any
    pressure_weight: Any
    stiffness_weight: Any
    force_weight: Any


class WallIntegral(TubeOp):
    """An integral over the wall by direct quadrature, at any radius and geometry.

    Inputs are internal radius ``a``, inner radius ``A``, outer radius ``B`` (mm), axial stretch,
    opening angle (rad), then the parameters in the order of the strain energy, vectors entry by
    entry; they broadcast against each other.
    """

    __props__ = ("strain_energy", "order")

    def __init__(self, input_types: Any = None, *, order: int = 32, **settings: Any) -> None:
        super().__init__(input_types, order=order, **settings)

    def wall(self, inputs: Sequence[TensorVariable]) -> tuple[WallRule, TensorVariable, Any]:
        """The quadrature, ``ln λz`` and the parameters' entries, nodes along a new last axis."""
        inputs = pt.broadcast_arrays(*(pt.expand_dims(x, -1) for x in inputs))
        geometry, entries = inputs[:5], inputs[5:]
        log_axial = pt.log(geometry[3])
        kinks = self.strain_energy.kinks(log_axial, **self.strain_energy.join(entries))
        return wall_rule(pt, *geometry, order=self.order, kinks=kinks), log_axial, entries


class PressureIntegral(WallIntegral):
    r"""Pressure of an inflated tube, and its derivative by the internal radius.

    With the wall coordinate ``s = ln R`` and the elongation ``δ`` of
    :func:`~pymc_hyperelastic.mechanics.tube.hoop_elongation`

    .. math::

        p(a) = \int_{\ln A}^{\ln B} \frac{T}{1 + δ} \, ds, \qquad
        \frac{dp}{da} = \int_{\ln A}^{\ln B}
            \left(\frac12 \frac{∂T}{∂\ln λ_θ} - T\right)
            \frac{2 k λ_z a}{R^2 (1 + δ)^2} \, ds, \qquad
        T = \frac{∂\hat W}{∂\ln λ_θ} = σ_{θθ} - σ_{rr},

    which is ``p = ∫ (∂Ŵ/∂λθ)/(λz r) dR`` in other variables. Both integrands are smooth, also at
    zero pressure and for ``a < A``.

    Inputs are internal radius ``a``, inner radius ``A``, outer radius ``B`` (mm), axial stretch,
    opening angle (rad), then the parameters in the order of the strain energy; they broadcast
    against each other. Outputs are pressure (kPa) and stiffness (kPa/mm) in the broadcast shape.

    Attributes
    ----------
    strain_energy : StrainEnergy
        The material.
    order : int, default 32
        Nodes of the Gauss-Legendre rule. In ``ln R`` the response of the common laws is nearly
        exponential. Wherever ``B/A ≤ 2.5``, ``0.8 ≤ λz ≤ 1.9``, ``Φ ≤ 160°`` and
        ``0.6 A ≤ a ≤ 1.7 A``, over the default priors' range of parameters, 32 nodes agree with
        200 to a relative 1e-10, and to 1e-12 for ``a ≥ A``; for laws with the exponential of a
        square, as long as pressure stays below a thousand moduli. A table of tests holds the rule
        to adaptive quadrature. A wall in which fibres slacken is divided there, with as many nodes
        on each piece.
    """

    def build_inner_graph(self, *inputs: TensorVariable) -> list[Variable]:
        """Gauss-Legendre quadrature over a last axis, which the sums remove."""
        wall, log_axial, entries = self.wall(inputs)
        stress = self.response(wall.log_hoop, log_axial, entries)
        slope = elementwise_derivative(stress, wall.log_hoop)
        return [
            (wall.pressure_weight * stress).sum(axis=-1),
            (wall.stiffness_weight * (slope / 2 - stress)).sum(axis=-1),
        ]


def wall_rule(
    xp: ModuleType,
    internal_radius: Any,
    inner_radius: Any,
    outer_radius: Any,
    axial_stretch: Any,
    opening_angle: Any,
    *,
    order: int = 32,
    kinks: Sequence[Any] = (),
) -> WallRule:
    """Quadrature of a wall, in pieces between the `kinks`, values of ``ln λθ``.

    The nodes run along the last axis, along which the arguments have length 1. `xp` is ``numpy``
    for numbers and ``pytensor.tensor`` for variables.
    """
    log_ratio = xp.log(outer_radius / inner_radius)
    k = opening_factor(opening_angle)
    tube = {
        "inner_radius": inner_radius,
        "axial_stretch": axial_stretch,
        "opening_angle": opening_angle,
    }
    node, weight = gauss_legendre(order)
    if kinks:
        excess = hoop_elongation(internal_radius, inner_radius, **tube)
        places = [_place(kink + xp.log(axial_stretch / k) / 2, excess, log_ratio) for kink in kinks]
        node, weight = _divided(node, weight, places)
    radius = inner_radius * xp.exp(node * log_ratio)
    delta = hoop_elongation(internal_radius, radius, **tube)
    log_hoop = (xp.log(k) - xp.log(axial_stretch) + xp.log1p(delta)) / 2
    stretching = 2 * k * axial_stretch * internal_radius / (radius * (1 + delta)) ** 2
    return WallRule(
        log_hoop,
        weight * log_ratio / (1 + delta),
        weight * log_ratio * stretching,
        np.pi / (k * axial_stretch) * weight * log_ratio * radius**2,
    )


def _place(log_stretch: Any, excess: Any, log_ratio: Any) -> TensorVariable:
    """Place of a hoop stretch in the wall, from 0 inside to 1 outside; 0 if it is not there.

    The stretch is given relative to that of the unloaded tube. Its square exceeds 1 by ``δ``, which
    falls with the square of the radius from `excess` at the inner surface.
    """
    beyond = pt.expm1(2 * log_stretch)
    ratio = excess / pt.where(pt.eq(beyond, 0.0), 1.0, beyond)
    inside = (ratio > 1) & (ratio < pt.exp(2 * log_ratio)) & pt.neq(beyond, 0.0)
    return pt.where(inside, pt.log(pt.where(inside, ratio, 1.0)) / (2 * log_ratio), 0.0)


def _divided(node: Any, weight: Any, places: Sequence[Any]) -> tuple[Any, Any]:
    """The rule on [0, 1] as one rule on each piece between the given places."""
    ends = [pt.zeros_like(places[0]), *_in_order(places), pt.ones_like(places[0])]
    pieces = list(pairwise(ends))
    return (
        pt.concatenate([low + (high - low) * node for low, high in pieces], axis=-1),
        pt.concatenate([(high - low) * weight for low, high in pieces], axis=-1),
    )


def _in_order(places: Sequence[Any]) -> list[Any]:
    """Few variables by their size; the gradient of PyTensor's own sort does not run in JAX."""
    ordered: list[Any] = []
    for place in places:
        for i, other in enumerate(ordered):
            ordered[i], place = pt.minimum(other, place), pt.maximum(other, place)
        ordered.append(place)
    return ordered


@_vectorize_node.register(WallIntegral)
def broadcast_batches(op: Op, node: Apply, *inputs: TensorVariable) -> Apply:
    """Broadcast batch dimensions from the left; the Op needs no loop over them."""
    core_ndim = node.outputs[0].type.ndim
    aligned = []
    for core, batched in zip(node.inputs, inputs, strict=True):
        batch_ndim = batched.type.ndim - core.type.ndim
        missing = range(batch_ndim, batch_ndim + core_ndim - core.type.ndim)
        aligned.append(pt.expand_dims(batched, tuple(missing)))
    return type(op)(**op._props_dict())(*aligned, return_list=True)[0].owner


def inflation_pressure(
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    *,
    inner_radius: Any,
    outer_radius: Any = None,
    axial_stretch: Any = 1.0,
    opening_angle: Any = 0.0,
    order: int = 32,
    **parameters: Any,
) -> TensorVariable:
    r"""Internal pressure that holds a tube at the given internal radius.

    .. math:: p(a) = \int_A^B \frac{∂\hat W/∂λ_θ}{λ_z r} \, dR

    See :class:`PressureIntegral` for the rule and its accuracy. Every argument may be a number, an
    array or a random variable; they broadcast against each other.

    Parameters
    ----------
    energy : StrainEnergy or list of Layer
        The material, such as ``ph.Ogden()``; or the layers of the wall from the inside out, see
        :class:`~pymc_hyperelastic.Layer`.
    internal_radius : tensor_like
        Current internal radius ``a``, mm.
    inner_radius, outer_radius : tensor_like
        Reference radii ``A < B``, mm; with layers no outer radius, they have their thickness.
    axial_stretch : tensor_like, default 1
        Axial stretch ``λz``.
    opening_angle : tensor_like, default 0
        Opening angle ``Φ`` of the cut ring, radians.
    order : int, default 32
        Nodes of the quadrature, on each piece of a wall in which fibres slacken. Twelve do for the
        wall of an artery, in half of the time.
    **parameters : tensor_like
        The material parameters by name; moduli in kPa.

    Returns
    -------
    TensorVariable
        Pressure in kPa, in the broadcast shape.

    Raises
    ------
    TypeError
        If a material parameter is missing or unknown.
    ValueError
        If a number given as geometry is impossible (``outer_radius <= inner_radius``, say).

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> p = ph.inflation_pressure(
    ...     ph.Ogden(), [7.0, 8.0, 9.0], inner_radius=7.0, outer_radius=9.0, mu=6.0, alpha=8.0
    ... )
    >>> (p.eval() / ph.mmHg).round(2)
    array([ 0.  ,  8.88, 19.  ])
    """
    tubes = checked_tubes(
        energy,
        internal_radius,
        inner_radius=inner_radius,
        outer_radius=outer_radius,
        axial_stretch=axial_stretch,
        opening_angle=opening_angle,
        parameters=parameters,
    )
    return wall_pressure(tubes, order)[0]


def inflation_stiffness(
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    *,
    inner_radius: Any,
    outer_radius: Any = None,
    axial_stretch: Any = 1.0,
    opening_angle: Any = 0.0,
    order: int = 32,
    **parameters: Any,
) -> TensorVariable:
    r"""Stiffness ``dp/da`` of a tube: derivative of its pressure by the internal radius.

    It governs the local speed of the pulse wave. Arguments are those of :func:`inflation_pressure`.

    Returns
    -------
    TensorVariable
        Stiffness in kPa/mm, in the broadcast shape.

    Raises
    ------
    TypeError
        If a material parameter is missing or unknown.
    ValueError
        If a number given as geometry is impossible.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> s = ph.inflation_stiffness(
    ...     ph.Ogden(), 8.0, inner_radius=7.0, outer_radius=9.0, mu=6.0, alpha=8.0
    ... )
    >>> round(float(s.eval()), 3)
    1.165
    """
    tubes = checked_tubes(
        energy,
        internal_radius,
        inner_radius=inner_radius,
        outer_radius=outer_radius,
        axial_stretch=axial_stretch,
        opening_angle=opening_angle,
        parameters=parameters,
    )
    return wall_pressure(tubes, order)[1]


def wall_pressure(tubes: Sequence[Tube], order: int = 32) -> tuple[TensorVariable, TensorVariable]:
    """Pressure and stiffness of a wall, added up over the tubes that it is made of."""
    pressure, stiffness = 0.0, 0.0
    for tube in tubes:
        integral = PressureIntegral(strain_energy=tube.energy, order=order)
        own_pressure, own_stiffness = integral(*tube.inputs)
        pressure += own_pressure
        # The internal radius a' of a layer grows by a/a' when that of the wall grows by 1.
        stiffness += own_stiffness * (tubes[0].radius / tube.radius if tube.within else 1.0)
    return pressure, stiffness


def checked_tubes(
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    *,
    inner_radius: Any,
    outer_radius: Any,
    axial_stretch: Any,
    opening_angle: Any,
    parameters: dict[str, Any],
) -> list[Tube]:
    """The tubes that make up a wall, after a check of what is given as numbers."""
    geometry = {
        "inner_radius": inner_radius,
        "axial_stretch": axial_stretch,
        "opening_angle": opening_angle,
    }
    outer = {} if outer_radius is None else {"outer_radius": outer_radius}
    check_geometry(internal_radius=internal_radius, **geometry, **outer)
    return tubes_of(
        energy, internal_radius, outer_radius=outer_radius, parameters=parameters, **geometry
    )


def check_geometry(**geometry: Any) -> None:
    """Raise for impossible numbers; random variables have no value to look at yet."""
    known = {
        name: _as_numbers(name, value)
        for name, value in geometry.items()
        if not isinstance(value, Variable)
    }
    for name, value in known.items():
        if name != "opening_angle" and not np.all((value > 0) & (value < np.inf)):
            raise ValueError(f"{name} must be positive and finite; got {value}")
    if {"inner_radius", "outer_radius"} <= set(known) and not np.all(
        known["outer_radius"] > known["inner_radius"]
    ):
        raise ValueError(
            f"outer_radius must exceed inner_radius; got {known['outer_radius']} and "
            f"{known['inner_radius']}"
        )
    if not np.all(np.abs(known.get("opening_angle", 0.0)) < 2 * np.pi):
        raise ValueError(
            f"opening_angle is in radians and below 2π; got {known['opening_angle']} (from "
            "degrees: np.deg2rad(angle))"
        )


def _as_numbers(name: str, value: Any) -> np.ndarray:
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError):
        raise TypeError(f"{name} is {value!r}; expected a number or an array of numbers") from None


@cache
def gauss_legendre(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of the Gauss-Legendre rule on [0, 1]."""
    node, weight = np.polynomial.legendre.leggauss(order)
    return (node + 1) / 2, weight / 2
