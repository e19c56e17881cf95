"""Independent ways to compute what the package computes, which use nothing of it.

Everything here is arithmetic of `mpmath` with a hundred digits: an energy is typed as the paper
prints it (with its slips corrected), its derivatives are central differences, and the integral over
the wall is taken in the reference radius with a Gauss-Legendre rule that doubles its order and
estimates its own error. The package differentiates symbolically, writes hyperbolic functions and
integrates in the logarithm of the radius with a fixed rule: the two share no formula but the
definition of the problem.
"""

from collections.abc import Callable, Mapping

import mpmath as mp

Energy = Callable[..., mp.mpf]
"""Strain energy of three stretches (radial, hoop, axial) and of parameters by name."""

# A difference with step 1e-15 errs by its square, some 1e-30. Every difference divides the error of
# rounding by its step: three nested ones, at alpha = 1e-12 where the energy itself loses 24 digits,
# still leave thirty digits of a hundred.
DIGITS = 100
STEP = mp.mpf("1e-15")
# What the quadrature may say of its own error, relative to the integrand at the ends of the wall.
# It says the worst and errs by far less.
QUADRATURE_ERROR = mp.mpf("1e-20")
KILOPASCAL_PER_KGF_CM2 = 98.0665


# --- strain energies, as the corrected paper prints them -----------------------------------------


def power_law_neo_hookean_energy(l1, l2, l3, *, mu, n):
    """``W = (mu/2) {[1 + (I1 - 3)/n]^n - 1}``."""
    return mu / 2 * ((1 + (l1**2 + l2**2 + l3**2 - 3) / n) ** n - 1)


def ogden_energy(l1, l2, l3, *, mu, alpha):
    """``W = (2 mu/alpha^2) (sum of l^alpha + l^-alpha, minus 6)``; ``2 mu sum ln^2 l`` at 0."""
    if alpha == 0:
        return 2 * mu * (mp.log(l1) ** 2 + mp.log(l2) ** 2 + mp.log(l3) ** 2)
    powers = sum(stretch**alpha + 1 / stretch**alpha for stretch in (l1, l2, l3))
    return 2 * mu / alpha**2 * (powers - 6)


def criscione_type_energy(l1, l2, l3, *, a, b):
    """``W = a cosh(b g3)``, ``g3 = 2 ln(l_theta) + ln(l_z)``."""
    return a * mp.cosh(b * (2 * mp.log(l2) + mp.log(l3)))


def ogden_1972_energy(l1, l2, l3):
    """``W = sum mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3)`` of that rubber, kPa."""
    return sum(
        KILOPASCAL_PER_KGF_CM2 * mu / alpha * (l1**alpha + l2**alpha + l3**alpha - 3)
        for mu, alpha in OGDEN_1972_RUBBER
    )


OGDEN_1972_RUBBER = ((6.3, 1.3), (0.012, 5.0), (-0.1, -2.0))
"""Pairs ``(mu_p, alpha_p)``, ``mu_p`` in kgf/cm^2, of vulcanised rubber.

Source: R. W. Ogden, "Large deformation isotropic elasticity: on the correlation of theory and
experiment for incompressible rubberlike solids", Proc. R. Soc. Lond. A 326 (1972) 565-584.
"""


# --- the tube ------------------------------------------------------------------------------------


def hoop_response(energy: Energy, hoop, axial, parameters: Mapping[str, float]) -> mp.mpf:
    """``dW^/dl_theta`` with ``W^(l_theta, l_z) = W(1/(l_theta l_z), l_theta, l_z)``."""

    def reduced(stretch):
        return energy(1 / (stretch * axial), stretch, axial, **parameters)

    return (reduced(hoop + STEP) - reduced(hoop - STEP)) / (2 * STEP)


def integral(integrand: Callable[[mp.mpf], mp.mpf], low: mp.mpf, high: mp.mpf) -> mp.mpf:
    """Integral by Gauss-Legendre rules of doubling order, up to 96 nodes on each half.

    The order that is reached hardly depends on the integrand, so integrals may be differenced.
    """
    # mpmath's estimate of the error holds for integrals of the size of one.
    scale = max(abs(integrand(low)), abs(integrand(high))) or mp.mpf(1)
    value, error = mp.quad(
        lambda x: integrand(x) / scale,
        [low, mp.sqrt(low * high), high],
        method="gauss-legendre",
        maxdegree=6,
        error=True,
    )
    if error > QUADRATURE_ERROR:
        raise ArithmeticError(f"the oracle's quadrature has the relative error {mp.nstr(error, 3)}")
    return value * scale


def pressure(
    energy: Energy,
    internal_radius,
    inner_radius,
    outer_radius,
    axial_stretch,
    opening_angle,
    parameters: Mapping[str, float],
) -> mp.mpf:
    """``p(a) = int_A^B (dW^/dl_theta) / (l_z r) dR`` by adaptive quadrature; angle in radians."""
    with mp.workdps(DIGITS):
        a, inner, outer, axial, angle = (
            mp.mpf(x)
            for x in (internal_radius, inner_radius, outer_radius, axial_stretch, opening_angle)
        )
        parameters = {name: mp.mpf(value) for name, value in parameters.items()}
        k = 2 * mp.pi / (2 * mp.pi - angle)

        def integrand(reference):
            current = mp.sqrt(a**2 + (reference**2 - inner**2) / (k * axial))
            response = hoop_response(energy, k * current / reference, axial, parameters)
            return response / (axial * current)

        return integral(integrand, inner, outer)


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


def tube_derivative(energy: Energy, inputs: Mapping[str, float], *by: str) -> float:
    """Pressure of a tube, differentiated by the named inputs.

    `inputs` names the five of `GEOMETRY` and the parameters. The stiffness is the derivative by
    ``"internal_radius"``, its gradient by the parameter ``"mu"`` that by
    ``"internal_radius", "mu"``.
    """

    def function(**values):
        geometry = [values.pop(name) for name in GEOMETRY]
        return pressure(energy, *geometry, values)

    return float(derivative(function, inputs, *by))


def pressure_by_stretch_integral(
    energy: Energy, internal_radius, inner_radius, outer_radius, axial_stretch=1.0
) -> float:
    """``p = int_{l_b}^{l_a} W^'(l) / (l^2 l_z - 1) dl``, without opening angle and for ``a > A``.

    The wall is passed through by its hoop stretch, which falls from ``l_a = a/A`` to ``l_b = b/B``.
    Source: D. M. Haughton and R. W. Ogden, J. Mech. Phys. Solids 27 (1979) 179-212.
    """
    with mp.workdps(DIGITS):
        a, inner, outer, axial = (
            mp.mpf(x) for x in (internal_radius, inner_radius, outer_radius, axial_stretch)
        )
        current_outer = mp.sqrt(a**2 + (outer**2 - inner**2) / axial)

        def integrand(stretch):
            return hoop_response(energy, stretch, axial, {}) / (stretch**2 * axial - 1)

        return float(integral(integrand, current_outer / outer, a / inner))


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
        mu, a, inner, outer, axial, angle = (
            mp.mpf(x)
            for x in (
                mu,
                internal_radius,
                inner_radius,
                outer_radius,
                axial_stretch,
                opening_angle,
            )
        )
        k = 2 * mp.pi / (2 * mp.pi - angle)
        b = mp.sqrt(a**2 + (outer**2 - inner**2) / (k * axial))
        return float(
            mu * k / axial * mp.log(outer / inner)
            - mu / (k * axial) * mp.log(b / a)
            + mu / (2 * k**2 * axial**2) * (k * axial * a**2 - inner**2) * (a**-2 - b**-2)
        )
