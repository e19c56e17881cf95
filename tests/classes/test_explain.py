"""Parts of the log ratio of a specimen's evidences under two classes."""

import itertools
from dataclasses import replace

import numpy as np
import pymc as pm
import pytest
from normal_specimens import repeated_class
from variable_classes import PRESSURE_SD, TRAINING, classify, curves, explain, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.average import Laws
from pymc_hyperelastic.classes.interface import Prediction
from pymc_hyperelastic.classes.shapley import log_ratio_parts, rivals_of, shapley
from pymc_hyperelastic.classes.specimen_evidence import PARTS, hybrid_evidences, specimen_evidence
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws, log_density

ROUNDING = 1e-10
# Nats: the smallest difference between classes that these tests compare with.
DIFFERENT = 0.1


@pytest.mark.parametrize("count", [1, 3])
def test_shapley_values_equal_means_over_all_orders(count):
    values = np.random.default_rng(count).standard_normal((2,) * count)
    expected = np.zeros(count)
    orders = [*itertools.permutations(range(count))]
    for order in orders:
        place = [0] * count
        for part in order:
            before = values[tuple(place)]
            place[part] = 1
            expected[part] += (before - values[tuple(place)]) / len(orders)
    np.testing.assert_allclose(shapley(values), expected, atol=ROUNDING)


def distribution(**changes):
    return repeated_class(50, np.eye(2), **changes)


def specimen(location=(0.1, 0.9)):
    """Draws of a specimen of three tests; each coordinate has a posterior sd of 0.1."""
    rng, count = np.random.default_rng(7), 4000
    centre = np.array(location)[:, None] + 0.1 * rng.standard_normal((2, count))
    scatter = 0.1**2 * rng.chisquare(6, (2, count)) / 3
    noise = -1.2 + 0.1 * rng.standard_normal(count)
    weight, none = np.full(count, -np.log(count)), np.empty((0, count))
    return SpecimenDraws(centre, scatter, noise[None], weight, 3, 0.0, centre.T, none, pareto_k=0.1)


def parts_of(own, other):
    """Parts of the log ratio, and the log ratio itself."""
    draws = specimen()
    ends = tuple(specimen_evidence(draws, d).log_evidence.value for d in (own, other))
    values = hybrid_evidences([draws], own, other, tuple(PARTS), ends)
    np.testing.assert_allclose(values.flat[[0, -1]], ends)
    return dict(zip(PARTS, shapley(values), strict=True)), ends[0] - ends[1]


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"location": [0.6, 1.0]}, "material"),
        ({"spread": [0.3, 1.2]}, "material"),
        ({"experiment_spread": [0.4, 0.6]}, "experiments"),
        ({"effect_spread": 1.0}, "experiments"),
        ({"log_size": [-0.2]}, "noise"),
        ({"noise_spread": [1.0]}, "noise"),
    ],
)
def test_only_the_part_that_differs_between_classes_is_not_zero(changes, part):
    parts, log_ratio = parts_of(distribution(), distribution(**changes))
    assert abs(log_ratio) > DIFFERENT
    np.testing.assert_allclose(parts.pop(part), log_ratio, atol=ROUNDING)
    np.testing.assert_allclose([*parts.values()], 0, atol=ROUNDING)


def test_mixed_evidence_equals_the_density_of_a_mixed_distribution():
    own = distribution()
    other = distribution(location=[0.5, 1.3], effect_spread=0.6, log_size=[-0.5])
    draws = specimen()
    mixed = replace(own, effect_spread=other.effect_spread, log_size=other.log_size)
    expected = np.log(np.mean(np.exp(log_density(np, vars(draws), mixed)[0])))
    ends = tuple(specimen_evidence(draws, d).log_evidence.value for d in (own, other))
    values = hybrid_evidences([draws], own, other, tuple(PARTS), ends)
    np.testing.assert_allclose(values[0, 1, 1], expected, atol=ROUNDING)
    # A more accurate evidence of one class shifts mixed evidences by a third of the change.
    moved = hybrid_evidences([draws], own, other, tuple(PARTS), (ends[0] + 0.3, ends[1]))
    np.testing.assert_allclose(moved[0, 1, 1], expected + 0.1, atol=ROUNDING)


def test_unreliable_mixed_evidence_is_nan_unless_a_second_sample_is_reliable():
    """A second sample of the specimen, near the other class, is used instead if there is one."""
    own, other = distribution(), distribution(location=[9.0, 1.0], log_size=[-0.5])
    bad, good = specimen(), specimen(location=(9.0, 1.0))
    settings = own, other, ("material", "noise"), (0.0, 0.0)
    assert np.isnan(hybrid_evidences([bad], *settings)[1, 0])
    assert np.isfinite(hybrid_evidences([bad, good], *settings)).all()


def test_rival_is_the_most_probable_other_class():
    values = np.array([-3.0, -4.0, -3.5])
    for prior, rivals in (((0.4, 0.3, 0.3), [2, 0, 0]), ((0.3, 0.6, 0.1), [1, 0, 0])):
        assert rivals_of(values + np.log(prior)) == rivals
    # A class of unknown probability is the least probable; of equal classes the first is the rival.
    assert rivals_of(np.array([np.nan, -2.0, -3.0])) == [1, 2, 1]
    assert rivals_of(np.zeros(3)) == [1, 0, 0]


def test_a_single_part_equals_the_log_ratio():
    laws, values = Laws(["law"], [("all",)], [ph.Estimate(0.0, 0.0)]), [-3.0, -4.0, -3.5]
    known = []
    for v in values:
        prediction = Prediction(ph.Estimate(v, 0.0), 0.0, "", 0.1)
        known.append(prediction._replace(hybrids=lambda i, v=v: np.array([v, values[i]])))
    assert log_ratio_parts(laws, [known], 0, 1).tolist() == [1.0]


@pytest.mark.filterwarnings("ignore:class .* evidence")
def test_classes_with_inferred_noise_have_a_material_and_a_noise_part():
    """The part of an inferred noise is the same for two specimens with the same noise."""
    ends = {"soft": ["A1", "A3"], "stiff": ["B1", "B3"]}
    training = {name: ph.select(TRAINING[name], specimen=own) for name, own in ends.items()}
    noise = pm.LogNormal.dist(np.log(PRESSURE_SD), 0.4)
    classes = fit(training=training, likelihood=noise, draws=100, chains=1)
    new = [curves({"N1": [modulus]}, 3) for modulus in (36.0, 50.0)]
    parts = [explain(data, classes)["log_ratio_part"].sel(class_label="soft") for data in new]
    assert parts[0]["part"].values.tolist() == ["material", "noise"]
    for data, own in zip(new, parts, strict=True):
        log_ratio = -np.diff(classify(data, classes)["log_evidence"], axis=1)[:, 0]
        np.testing.assert_allclose(own.sum("part"), log_ratio)
    material, noise = (parts[0] - parts[1]).values.ravel()
    assert material > 0.5 > 0.25 > abs(noise)
