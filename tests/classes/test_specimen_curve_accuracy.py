"""Accuracy of the curves of a specimen at nodes selected for the prior, against quadrature."""

import numpy as np
import pandas as pd
import pytest
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.classes.specimens import SpecimenSampler
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import Integral
from pymc_hyperelastic.mechanics.selected_nodes import SelectedNodes
from pymc_hyperelastic.mechanics.wall import WALL_ORDER
from pymc_hyperelastic.models.forward.integrator import PointwiseQuadrature
from pymc_hyperelastic.models.forward.numbers import numeric_curves
from pymc_hyperelastic.models.forward.tabulated import TabulatedQuadrature

SEED = 20261127
# Nats: the largest error of a log likelihood, and its growth with the depth below the best draw.
TOLERANCE, RELATIVE_TOLERANCE = 0.003, 1e-4
# Nats: depth from which draws are not compared.
DEEP = 3000.0


def protocols(growth=1.1):
    """Three inflation and two extension tests; with a small `growth` some fibres are slack."""
    tests = [
        {"radius": growth * np.linspace(0.47, 0.62, 12), "stretch": s} for s in (1.4, 1.5, 1.6)
    ]
    stretch = np.linspace(1.4, 1.6, 12)
    for radius in (0.5, 0.6):
        tests.append({"radius": growth * radius - 0.1 * (stretch - 1.4), "stretch": stretch})
    frame = pd.concat([pd.DataFrame(t).assign(experiment=i) for i, t in enumerate(tests)])
    frame = frame.assign(specimen="A", pressure=60 * (frame["radius"] / growth - 0.4))
    frame["axial_force"] = 30 * (frame["stretch"] - 1.2)
    tube = ph.Tube(inner_radius=0.45, outer_radius=0.57, axial_stretch="stretch")
    return ph.inflation_data(frame, tube, check="ignore")


def sampler_of(data):
    return HierarchicalClass.of_settings(ph.HolzapfelGasserOgden(), 1.0).sampler(data)


@pytest.fixture(scope="module")
def taut():
    data = protocols()
    return sampler_of(data), data


@pytest.mark.deep
def test_likelihood_by_selected_nodes_equals_quadrature(taut):
    """At draws of the prior that were not used to select the nodes."""
    sampler, data = taut
    assert isinstance(sampler.forward.integrator.basis, SelectedNodes)
    exact = SpecimenSampler(
        sampler.population,
        sampler.population.forward_model(data, by_test=False, mode="quadrature"),
        sampler.reference,
    )
    points = sampler.target(data).draw_prior(1000, np.random.default_rng(SEED))
    found, expected = (one.target(data).score(points)[1] for one in (sampler, exact))
    near = expected > expected.max() - DEEP
    assert near.sum() > 100
    allowed = TOLERANCE + RELATIVE_TOLERANCE * (expected.max() - expected[near])
    assert np.mean(np.abs(found[near] - expected[near]) < allowed) > 0.99


def test_integrator_is_refined_if_fibres_slacken_between_nodes():
    """The integrator is refined if the curves of the particles err by more than is allowed."""
    data, angle, integrators = protocols(0.93), np.log(5.0 / (90 - 5.0)), []
    sampler = sampler_of(data)

    def take(sampler):
        target = sampler.target(data)
        points = target.draw_prior(50, np.random.default_rng(SEED))
        points[:, sampler.scale.names.index("logit_beta")] = angle
        integrators.append(sampler.forward.integrator)
        return Integral(Estimate(0.0, 0.0), 0.0, "importance", points), target

    found, _ = sampler._with_accurate_curves(data, take)
    assert len(integrators) > 1 and len(set(map(id, integrators))) == len(integrators)
    assert np.isfinite(found.log_value.standard_error)


@pytest.mark.parametrize("error", [np.nan, *deep([2e-6])])
def test_evidence_error_is_infinite_if_curves_stay_inaccurate(error, taut, monkeypatch):
    (sampler, data), taken = taut, []

    def take(sampler):
        taken.append(sampler)
        target = sampler.target(data)
        points = target.draw_prior(20, np.random.default_rng(SEED))
        return Integral(Estimate(0.0, 0.0), 0.0, "importance", points), target

    def wrong(integrator, *given):
        is_exact = getattr(integrator, "order", None) == 3 * WALL_ORDER
        curves = numeric_curves(*given, 3 * WALL_ORDER)
        return {name: curve * (1 if is_exact else 1 + error) for name, curve in curves.items()}

    for kind in (TabulatedQuadrature, PointwiseQuadrature):
        monkeypatch.setattr(kind, "values", wrong)

    with pytest.warns(UserWarning, match="wrong by more than 1e-06"):
        found, _ = sampler._with_accurate_curves(data, take)
    assert found.log_value.standard_error == np.inf and len(taken) == 5
