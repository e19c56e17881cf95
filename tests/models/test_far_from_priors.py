"""Curves of materials that priors hardly expect: they are known to be wrong, or made right."""

import numpy as np
import pymc as pm
import pytest
from test_empirical import WITH_FORCE, protocols

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.batched import BatchedFunction

# Fibres that bear nothing at first and stiffen all the more.
FAR = {
    "c": np.array([10.0, 12.0]),
    "k1": np.array([1e-6, 1e-5]),
    "k2": np.array([9.0, 7.0]),
    "beta": np.array([40.0, 35.0]),
}
SMOOTH = {"mu": np.array([1e-5, 1e-4]), "alpha": np.array([30.0, 25.0])}
EXPECTED = {
    "c": (1.0, 40.0),
    "k1": (0.5, 50.0),
    "k2": (0.1, 2.0),
    "mu": (1.0, 20.0),
    "alpha": (1.0, 6.0),
    "beta": (20.0, 50.0),
}
LAWS = {"HolzapfelGasserOgden": FAR, "Ogden": SMOOTH}


def priors_of(energy):
    return {name: pm.Uniform.dist(*EXPECTED[name]) for name in energy.parameter_names}


def forward_of(law, data, **settings):
    energy = ph.StrainEnergy.from_name(law)
    return WITH_FORCE.forward_model(energy, data, priors_of(energy), **settings)


def curves_of(forward, parameters):
    """Curves of each of the materials."""
    with pm.Model() as model:
        values = {name: pm.Flat(name) for name in parameters}
        curves = forward.tube(values).curves()
    both = model.replace_rvs_by_values([curves["pressure"], curves["axial_force"]])
    function = BatchedFunction.of_model(model, both)
    return function(np.stack([*parameters.values()], axis=1))


def exact_errors(forward, law, data, parameters):
    """The largest difference from quadrature by material, relative to the largest value."""
    quadrature = forward_of(law, data, mode="quadrature")
    both = zip(curves_of(forward, parameters), curves_of(quadrature, parameters), strict=True)
    errors = [np.abs(a - b).max(axis=1) / np.abs(b).max(axis=1) for a, b in both]
    return np.max(errors, axis=0)


@pytest.mark.parametrize("law", LAWS)
def test_errors_are_those_of_quadrature(law):
    """Of extension tests and inflation tests, far from what priors expect and made right there."""
    data, far = protocols(), LAWS[law]
    forward = forward_of(law, data)
    found = forward.errors(data, far)
    assert found.max() > 1e-6
    # They are by group of tests, whose curves are not all as large.
    np.testing.assert_allclose(
        np.log(found / exact_errors(forward, law, data, far)), 0, atol=np.log(3)
    )
    right = forward.right_for(far)
    assert right.errors(data, far).max() < 1e-8
    assert exact_errors(right, law, data, far).max() < 1e-8


def test_an_evidence_by_wrong_curves_is_not_to_be_trusted():
    """What the draws of a posterior are asked for, and what follows."""
    energy, data = ph.Ogden(), protocols()
    model = ph.inflation_model(energy, data, priors=priors_of(energy), **WITH_FORCE.noise)
    settings = {"draws": 200, "chains": 2, "random_seed": 1, "progressbar": False}
    tree = ph.sample_smc(model, **settings)
    assert tree["evidence"]["curve_error"] < 1e-9
    assert ph.diagnose_evidence(tree)["verdict"].sel(check="curves") == "good"
    far = {name: values[None] for name, values in SMOOTH.items()}
    tree["evidence"]["curve_error"] = model.study.curve_error(far)
    del tree["diagnosis"]
    diagnosis = ph.diagnose_evidence(tree)
    assert diagnosis.attrs["verdict"] == "not to be trusted"
    assert "wider priors" in diagnosis.attrs["words"]
    assert np.isinf(ph.log_evidence(tree).standard_error)
