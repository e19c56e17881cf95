"""Independent ways to compute what the package computes, which use no code of the package.

The arithmetic is that of `mpmath` with a hundred digits. An energy is written as its source prints
it, its derivatives are central differences, and the integral over the wall is taken in the
reference radius by a Gauss-Legendre rule whose order doubles until its error estimate is small. The
wall is divided where fibres slacken, at radii found by a scan and bisection. The package
differentiates symbolically, writes hyperbolic functions and integrates in the logarithm of the
radius with a fixed rule: the two share no formula but the definition of the problem.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import mpmath as mp
from mpmath.calculus.quadrature import GaussLegendre

Energy = Callable[..., mp.mpf]
"""Strain energy of three stretches (radial, hoop, axial) and of parameters by name."""
Switches = Callable[..., tuple[mp.mpf, ...]]
"""Fibre strains at hoop and axial stretch: stress is not smooth where one changes its sign."""


def no_switches(hoop, axial, **parameters):
    """Return no strains: the energy is smooth."""
    return ()


# A difference with step 1e-15 errs by its square, some 1e-30. Every difference divides the error of
# rounding by its step: three nested ones, at alpha = 1e-12 where the energy itself loses 24 digits,
# still leave thirty digits of a hundred.
DIGITS = 100
STEP = mp.mpf("1e-15")
# Largest error estimate of the quadrature, relative to the integrand at the ends of the wall. The
# estimate is pessimistic; the order doubles until each half of the wall is below this limit.
QUADRATURE_ERROR = mp.mpf("1e-20")
LARGEST_DEGREE = 5
# Points of the scan for fibres that slacken, which no strain of the table passes through twice
# between neighbours, and the halvings that then find the place to 1e-40: the response has a kink
# there, so the integral feels the square of that error.
SCAN = 24
HALVINGS = 130
# A strain below this is rounding: fibres of a tube at rest, or along a tube that is not stretched.
NO_STRAIN = mp.mpf("1e-80")


# --- the tube ------------------------------------------------------------------------------------


def hoop_response(energy: Energy, hoop, axial, parameters: Mapping[str, float]) -> mp.mpf:
    """``dW^/dl_theta`` with ``W^(l_theta, l_z) = W(1/(l_theta l_z), l_theta, l_z)``."""

    def reduced(stretch):
        return energy(1 / (stretch * axial), stretch, axial, **parameters)

    return (reduced(hoop + STEP) - reduced(hoop - STEP)) / (2 * STEP)


def axial_response(energy: Energy, hoop, axial, parameters: Mapping[str, float]) -> mp.mpf:
    """``dW^/dl_z`` of the same reduced energy."""

    def reduced(stretch):
        return energy(1 / (hoop * stretch), hoop, stretch, **parameters)

    # Fibres along the tube slacken at an axial stretch of 1 exactly, where a difference errs by its
    # step and not by the square: this step is that square.
    return (reduced(axial + STEP**2) - reduced(axial - STEP**2)) / (2 * STEP**2)


# The rule keeps its nodes. Unlike `mpmath.quad`, which uses it, it accepts an error limit: all
# hundred digits of an integral would take four times as long.
_RULE = GaussLegendre(mp.mp)


def integral(integrand: Callable[[mp.mpf], mp.mpf], low: mp.mpf, high: mp.mpf) -> mp.mpf:
    """Integral by Gauss-Legendre rules of doubling order, up to 48 nodes on each half.

    The final order hardly depends on the integrand, so differences of integrals are accurate.
    """
    # mpmath's estimate of the error holds for integrals of the size of one.
    scale = max(abs(integrand(low)), abs(integrand(high))) or mp.mpf(1)
    with mp.extraprec(20):
        value, error = _RULE.summation(
            lambda x: integrand(x) / scale,
            [low, mp.sqrt(low * high), high],
            mp.mp.prec,
            QUADRATURE_ERROR,
            LARGEST_DEGREE,
        )
    if error > 2 * QUADRATURE_ERROR:
        raise ArithmeticError(f"the oracle's quadrature has the relative error {mp.nstr(error, 3)}")
    return value * scale


def sign_changes(function: Callable[[mp.mpf], mp.mpf], low: mp.mpf, high: mp.mpf) -> list[mp.mpf]:
    """Return where a function changes its sign, by a scan in equal ratios and bisection."""

    def sign(x):
        value = function(x)
        return mp.sign(value) if abs(value) > NO_STRAIN else 0

    points = [low * (high / low) ** (mp.mpf(i) / SCAN) for i in range(SCAN + 1)]
    points = [(x, sign(x)) for x in points]
    found = []
    # A point of the scan at which the function is zero is left out.
    for (before, sign_before), (after, sign_after) in pairwise([p for p in points if p[1]]):
        if sign_before == sign_after:
            continue
        for _ in range(HALVINGS):
            middle = (before + after) / 2
            if sign(middle) == sign_before:
                before = middle
            else:
                after = middle
        found.append((before + after) / 2)
    return found


class Layer(NamedTuple):
    """One material of a wall, up to an outer radius of the reference tube."""

    energy: Energy
    parameters: Mapping[str, float]
    outer_radius: float
    switches: Switches = no_switches


def wall_integral(
    density: Callable[..., mp.mpf],
    layers: Sequence[Layer],
    internal_radius,
    inner_radius,
    axial_stretch,
    opening_angle,
) -> mp.mpf:
    """Integral of a density over the reference radius, from the inside of the wall to the outside.

    The one map ``r(R)`` serves all layers. The integral is divided between layers and where fibres
    slacken. `density` takes the layer, ``R``, ``r``, the axial stretch and ``k``.
    """
    with mp.workdps(DIGITS):
        a, inner, axial, angle = map(
            mp.mpf, (internal_radius, inner_radius, axial_stretch, opening_angle)
        )
        k = 2 * mp.pi / (2 * mp.pi - angle)

        def current(reference):
            return mp.sqrt(a**2 + (reference**2 - inner**2) / (k * axial))

        total, low = mp.mpf(0), inner
        for layer in layers:
            high = mp.mpf(layer.outer_radius)
            layer = layer._replace(
                parameters={name: mp.mpf(value) for name, value in layer.parameters.items()}
            )
            cuts = [low, *_switch_radii(layer, current, axial, k, low, high), high]
            for start, end in pairwise(cuts):
                total += integral(
                    lambda reference, layer=layer: density(
                        layer, reference, current(reference), axial, k
                    ),
                    start,
                    end,
                )
            low = high
        return total


def _switch_radii(layer: Layer, current, axial, k, low, high) -> list[mp.mpf]:
    """Reference radii within a layer at which its response is not smooth, in order."""

    def strains(reference):
        return layer.switches(k * current(reference) / reference, axial, **layer.parameters)

    found = sorted(
        radius
        for i in range(len(strains(low)))
        for radius in sign_changes(lambda reference, i=i: strains(reference)[i], low, high)
    )
    # Two families may slacken at one place.
    return [x for i, x in enumerate(found) if i == 0 or x - found[i - 1] > STEP * x]


def layered_pressure(layers: Sequence[Layer], *tube) -> mp.mpf:
    """``p(a) = int_A^B (dW^/dl_theta) / (l_z r) dR``; `tube` is that of `wall_integral`."""

    def density(layer, reference, current, axial, k):
        response = hoop_response(layer.energy, k * current / reference, axial, layer.parameters)
        return response / (axial * current)

    return wall_integral(density, layers, *tube)


def layered_force(layers: Sequence[Layer], *tube) -> mp.mpf:
    """Axial force less the thrust of the pressure.

    ``F = pi/(k l_z) int_A^B (2 l_z dW^/dl_z - l_theta dW^/dl_theta) R dR``.
    """

    def density(layer, reference, current, axial, k):
        hoop = k * current / reference
        along = axial * axial_response(layer.energy, hoop, axial, layer.parameters)
        around = hoop * hoop_response(layer.energy, hoop, axial, layer.parameters)
        return mp.pi / (k * axial) * (2 * along - around) * reference

    return wall_integral(density, layers, *tube)


def layered_material(layers: Sequence[Layer], *tube) -> tuple[mp.mpf, mp.mpf, mp.mpf]:
    """Means over the wall of stored energy, and of two moduli.

    The moduli are differences of the Cauchy stresses ``s_t - s_r`` and ``s_z - s_r`` between two
    states of each circle, stretched further by ``e^+-h`` around or along and thinned as much.
    """

    def mean(of_circle):
        def density(layer, reference, current, axial, k):
            hoop = k * current / reference
            return of_circle(layer.energy, hoop, axial, layer.parameters) * reference

        outer, inner = mp.mpf(layers[-1].outer_radius), mp.mpf(tube[1])
        return 2 * wall_integral(density, layers, *tube) / (outer**2 - inner**2)

    def stored(energy, hoop, axial, parameters):
        one = mp.mpf(1)
        at_rest = energy(one, one, one, **parameters)
        return energy(1 / (hoop * axial), hoop, axial, **parameters) - at_rest

    def slope(stress):
        return (stress(mp.exp(STEP)) - stress(mp.exp(-STEP))) / (2 * STEP)

    def around(energy, hoop, axial, parameters):
        return slope(lambda g: hoop * g * hoop_response(energy, hoop * g, axial, parameters))

    def along(energy, hoop, axial, parameters):
        return slope(lambda g: axial * g * axial_response(energy, hoop, axial * g, parameters))

    return mean(stored), mean(around), mean(along)


GEOMETRY = ("internal_radius", "inner_radius", "outer_radius", "axial_stretch", "opening_angle")


def derivative(function: Callable[..., mp.mpf], inputs: Mapping[str, float], *by: str) -> mp.mpf:
    """Partial derivative of ``function(**inputs)`` by one input, or by several in turn."""
    with mp.workdps(DIGITS):
        if not by:
            return function(**inputs)
        *rest, name = by
        centre = mp.mpf(inputs[name])
        above = derivative(function, {**inputs, name: centre + STEP}, *rest)
        below = derivative(function, {**inputs, name: centre - STEP}, *rest)
        return (above - below) / (2 * STEP)


def tube_derivative(
    energy: Energy,
    inputs: Mapping[str, float],
    *by: str,
    switches: Switches = no_switches,
    quantity: Callable[..., mp.mpf] = layered_pressure,
) -> float:
    """Pressure of a tube, or its axial force, differentiated by the named inputs.

    `inputs` names the five of `GEOMETRY` and the parameters. The stiffness is the derivative by
    ``"internal_radius"``, its gradient by the parameter ``"mu"`` that by
    ``"internal_radius", "mu"``.
    """

    def function(internal_radius, inner_radius, outer_radius, axial_stretch, opening_angle, **rest):
        layer = Layer(energy, rest, outer_radius, switches)
        return quantity([layer], internal_radius, inner_radius, axial_stretch, opening_angle)

    return float(derivative(function, inputs, *by))


def neo_hookean_pressure(
    mu, internal_radius, inner_radius, outer_radius, axial_stretch=1.0, opening_angle=0.0
) -> float:
    r"""Closed form of the thick neo-Hookean tube, ``W = (mu/2)(I1 - 3)``.

    With ``dW^/dl = mu (l - 1/(l^3 l_z^2))`` and ``l = k r/R`` the integrand of the pressure is
    ``mu [k/(l_z R) - R^3/(k^3 l_z^3 r^4)]``. In ``u = r^2``, where ``R^2 = A^2 + k l_z (u - a^2)``
    and ``R dR = (k l_z/2) du``, the second term becomes ``mu/(2 k^2 l_z^2)`` times the integral of
    ``[k l_z u + A^2 - k l_z a^2]/u^2``, and

        p = mu k/l_z ln(B/A) - mu/(k l_z) ln(b/a)
            + mu/(2 k^2 l_z^2) (k l_z a^2 - A^2) (1/a^2 - 1/b^2),

    ``b^2 = a^2 + (B^2 - A^2)/(k l_z)``. For ``k = l_z = 1`` it is the textbook's
    ``mu ln(B a/(A b)) + (mu/2)(a^2 - A^2)(1/a^2 - 1/b^2)`` (Ogden, "Non-linear elastic
    deformations", Dover 1997, section 5.3).
    """
    with mp.workdps(DIGITS):
        tube = internal_radius, inner_radius, outer_radius, axial_stretch, opening_angle
        mu, a, inner, outer, axial, angle = map(mp.mpf, (mu, *tube))
        k = 2 * mp.pi / (2 * mp.pi - angle)
        b = mp.sqrt(a**2 + (outer**2 - inner**2) / (k * axial))
        return float(
            mu * k / axial * mp.log(outer / inner)
            - mu / (k * axial) * mp.log(b / a)
            + mu / (2 * k**2 * axial**2) * (k * axial * a**2 - inner**2) * (a**-2 - b**-2)
        )
