"""Biaxial tests of human myocardium: published parameters of the Holzapfel-Ogden law."""

import numpy as np
import pytest
from problems import AS_WRITTEN

import pymc_hyperelastic as ph

# Coefficients of determination are stated with two decimals.
PRINTED = 0.005

# Averages over specimens. The stretches rise in ten equal steps from 1; those of the fibre and the
# cross-fibre direction end at 1 + 0.1 times the ratio of the test. Nominal stresses in kPa of the
# fibre direction, then of the cross-fibre direction.
# Source: G. Sommer et al., Acta Biomaterialia 24 (2015) 172-192, as tabulated in
# github.com/LivingMatterLab/CANN, HEART/input/CANNsHEARTdata_shear05.xlsx.
BIAXIAL = {
    (1.0, 1.0): (
        (0.0, 0.00227, 0.012, 0.241, 0.496, 0.847, 1.369, 2.158, 3.404, 5.297, 8.257),
        (0.0, 0.009, 0.046, 0.07, 0.229, 0.447, 0.779, 1.281, 2.013, 3.125, 4.791),
    ),
    (1.0, 0.75): (
        (0.0, 0.0, 0.0843, 0.2039, 0.3823, 0.6784, 1.0921, 1.6626, 2.5469, 3.8233, 5.8645),
        (0.0, 0.0, 0.0049, 0.1044, 0.1843, 0.3622, 0.5401, 0.8357, 1.2685, 1.9367, 2.7617),
    ),
    (0.75, 1.0): (
        (0.0, 0.0388, 0.0777, 0.1553, 0.3107, 0.4854, 0.7573, 1.1262, 1.6893, 2.5049, 3.6699),
        (0.0, 0.0388, 0.0777, 0.1359, 0.233, 0.3689, 0.5437, 0.8544, 1.301, 1.8835, 2.7961),
    ),
    (1.0, 0.5): (
        (0.0, 0.035, 0.071, 0.204, 0.298, 0.546, 0.871, 1.331, 2.06, 3.116, 4.748),
        (0.0, 0.016, 0.015, 0.091, 0.129, 0.243, 0.377, 0.568, 0.856, 1.201, 1.719),
    ),
    (0.5, 1.0): (
        (0.0, 0.158, 0.244, 0.329, 0.471, 0.632, 0.776, 1.057, 1.354, 1.828, 2.437),
        (0.0, 0.263, 0.336, 0.467, 0.676, 0.807, 1.112, 1.419, 1.802, 2.32, 3.034),
    ),
}

# Exponent and factor of each term of the general law of Holzapfel and Ogden, fitted to these tests
# and to six tests in simple shear. The modulus is 2 times the exponent times the factor. In biaxial
# tests the fibres of the sheet direction are slack, and the terms with shear are zero.
# Source: D. Martonova et al., Automated model discovery for human cardiac tissue: discovering the
# best model and parameters, doi:10.1101/2024.02.27.582427; weights in
# github.com/LivingMatterLab/CANN, HEART/aligned_fibers/results_shear05/HeartCANN/
# wg32_shear05_orthotrop_HO_general_L1_wg1_30000_32_0.0/heart/biaxial_shear_all/Config_file.txt.
TERMS = {
    "": (5.4576616287231445, 0.08758517354726791),
    "_fibre": (23.701007843017578, 0.07084079086780548),
    "_cross": (16.976699829101562, 0.060534607619047165),
}
HUMAN = {f"a{term}": 2 * b * factor for term, (b, factor) in TERMS.items()}
HUMAN |= {f"b{term}": b for term, (b, _) in TERMS.items()}
# Coefficients of determination of these parameters. The source prints that of one test in shear.
FOUND = {
    (1.0, 1.0): (0.83, 0.78),
    (1.0, 0.75): (0.95, 0.77),
    (0.75, 1.0): (0.87, 0.87),
    (1.0, 0.5): (0.88, 0.74),
    (0.5, 1.0): (0.70, 0.95),
}


def nominal(ratio, parameters):
    """Return the nominal stresses of a test in kPa."""
    stretches = (1 + 0.1 * end * np.linspace(0, 1, 11) for end in ratio)
    stress = ph.sheet_stress(ph.HolzapfelOgden(), *stretches, nominal=True, **parameters)
    return [component.eval(mode=AS_WRITTEN) for component in stress]


@pytest.mark.parametrize("ratio", BIAXIAL)
def test_published_parameters_describe_human_myocardium(ratio):
    """The sum of squares of each curve is 5 to 30 % of that around the mean stress."""
    found = [
        1 - np.square(np.subtract(stress, curve)).sum() / (len(stress) * np.var(stress))
        for stress, curve in zip(BIAXIAL[ratio], nominal(ratio, HUMAN), strict=True)
    ]
    np.testing.assert_allclose(found, FOUND[ratio], atol=PRINTED, rtol=0)


# Without cross-fibres, for the biaxial tests of figure 8: G. A. Holzapfel and R. W. Ogden,
# Philosophical Transactions of the Royal Society A 367 (2009) 3445-3475, as stated in
# github.com/finsberg/pulse, demo/biaxial_stress_test/biaxial_stress_test.py.
FIGURE_8 = {"a": 2.28, "b": 9.726, "a_fibre": 1.685, "b_fibre": 15.779}
FIGURE_8 |= {"a_cross": 0.0, "b_cross": 1.0}


def test_stress_equals_the_equation_of_the_source():
    """The pressure, which incompressibility leaves open, is that of an unloaded face."""
    for parameters in (FIGURE_8, HUMAN):
        a, b, *families = (parameters[name] for name in ph.HolzapfelOgden().parameter_names)
        for ratio in BIAXIAL:
            squares = [(1 + 0.1 * end * np.linspace(0, 1, 11)) ** 2 for end in ratio]
            thickness = 1 / (squares[0] * squares[1])
            matrix = a * np.exp(b * (sum(squares) + thickness - 3))
            expected = [
                matrix * (square - thickness) / np.sqrt(square)
                + 2
                * modulus
                * (square - 1)
                * np.exp(exponent * (square - 1) ** 2)
                * np.sqrt(square)
                for square, modulus, exponent in zip(
                    squares, families[::2], families[1::2], strict=True
                )
            ]
            np.testing.assert_allclose(nominal(ratio, parameters), expected, rtol=1e-12, atol=1e-14)
