"""What drives an answer: parts of a log ratio of evidences add up, and name what differs."""

import itertools
from dataclasses import replace

import numpy as np
import pymc as pm
import pytest
from variable_classes import NAMES, SIGMA, TRAINING, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.parts import shapley
from pymc_hyperelastic.classes.specimen_evidence import (
    PARTS,
    hybrid_evidences,
    specimen_evidence,
)
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws, log_density

ROUNDING = 1e-10
# Nats, of evidences that are means over the same 4000 draws of the specimen.
TOLERANCE = 0.02


# --- the formula ----------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_parts_are_means_over_all_orders(count):
    """Each order of exchanging them one by one counts alike, and the sum is the difference."""
    values = np.random.default_rng(count).standard_normal((2,) * count)
    expected = np.zeros(count)
    orders = [*itertools.permutations(range(count))]
    for order in orders:
        place = [0] * count
        for part in order:
            before = values[tuple(place)]
            place[part] = 1
            expected[part] += (before - values[tuple(place)]) / len(orders)
    parts = shapley(values)
    np.testing.assert_allclose(parts, expected, atol=ROUNDING)
    np.testing.assert_allclose(parts.sum(), values.flat[0] - values.flat[-1], atol=ROUNDING)
    # Seen from the other class they are the same with the other sign.
    np.testing.assert_allclose(shapley(np.flip(values)), -parts, atol=ROUNDING)


# --- specimens and distributions that are written down --------------------------------------------


def distribution(count=50, **changes):
    """The same distribution of two coordinates, experiments and noise, so many times."""
    numbers = {
        "location": [0.0, 1.0],
        "spread": [0.3, 0.4],
        "experiment_spread": [0.1, 0.1],
        "effect_spread": 0.3,
        "log_sigma": [-1.0],
        "noise_spread": [0.3],
    } | changes
    repeated = {name: np.multiply.outer(v, np.ones((count, 1))) for name, v in numbers.items()}
    return ClassDistribution(factor=np.eye(2), **repeated)


def specimen(location=(0.1, 0.9), log_sigma=-1.2, apart=0.1):
    """Draws of a specimen of three tests, whose curves tell all of it to a tenth."""
    rng, count = np.random.default_rng(7), 4000
    centre = np.array(location)[:, None] + 0.1 * rng.standard_normal((2, count))
    scatter = apart**2 * rng.chisquare(6, (2, count)) / 3
    noise = log_sigma + 0.1 * rng.standard_normal(count)
    weight, none = np.full(count, -np.log(count)), np.empty((0, count))
    return SpecimenDraws(centre, scatter, noise[None], weight, 3, 0.0, centre.T, none, pareto_k=0.1)


def parts_of(own, other, draws=None, parts=tuple(PARTS)):
    """Parts of the log ratio, and the log ratio itself."""
    draws = draws or specimen()
    ends = tuple(specimen_evidence(draws, d).log_evidence.value for d in (own, other))
    values = hybrid_evidences([draws], own, other, parts, ends)
    np.testing.assert_allclose(values.flat[[0, -1]], ends)
    return dict(zip(parts, shapley(values), strict=True)), ends[0] - ends[1]


# Each row: what differs between two classes, and of which part that is.
DIFFERENT = {
    "stiffness": ({"location": [0.6, 1.0]}, "material"),
    "spread": ({"spread": [0.3, 1.2]}, "material"),
    "experiments": ({"experiment_spread": [0.4, 0.2]}, "experiments"),
    "their differences": ({"effect_spread": 1.0}, "experiments"),
    "noise": ({"log_sigma": [-0.2]}, "noise"),
    "spread of noise": ({"noise_spread": [1.0]}, "noise"),
}


@pytest.mark.parametrize(("changes", "part"), DIFFERENT.values(), ids=DIFFERENT)
def test_one_difference_is_one_part(changes, part):
    """Of classes that differ in nothing else, all of the log ratio is that part's."""
    parts, log_ratio = parts_of(distribution(), distribution(**changes))
    assert abs(log_ratio) > 0.1
    np.testing.assert_allclose(parts.pop(part), log_ratio, atol=ROUNDING)
    np.testing.assert_allclose([*parts.values()], 0, atol=ROUNDING)


def test_parts_of_classes_that_differ_in_all_add_up():
    """Noise is independent of the rest: its part is that which it has alone, as the others have."""
    changes = {"location": [0.5, 1.3], "experiment_spread": [0.3, 0.2], "log_sigma": [-0.5]}
    own, other = distribution(), distribution(**changes)
    parts, log_ratio = parts_of(own, other)
    np.testing.assert_allclose(sum(parts.values()), log_ratio, atol=ROUNDING)
    noise, _ = parts_of(own, replace(own, log_sigma=other.log_sigma))
    np.testing.assert_allclose(parts["noise"], noise["noise"], atol=TOLERANCE)
    assert parts["material"] > 0.5 and parts["experiments"] > 0.1


def test_hybrids_are_densities_of_exchanged_parts():
    """Against the sum over draws of a distribution that is put together by hand."""
    own = distribution()
    other = distribution(location=[0.5, 1.3], effect_spread=0.6, log_sigma=[-0.5])
    draws = specimen()
    mixed = replace(own, effect_spread=other.effect_spread, log_sigma=other.log_sigma)
    expected = np.log(np.mean(np.exp(log_density(np, vars(draws), mixed)[0])))
    ends = tuple(specimen_evidence(draws, d).log_evidence.value for d in (own, other))
    values = hybrid_evidences([draws], own, other, tuple(PARTS), ends)
    np.testing.assert_allclose(values[0, 1, 1], expected, atol=ROUNDING)
    # What is known better of the two classes themselves is divided evenly.
    moved = hybrid_evidences([draws], own, other, tuple(PARTS), (ends[0] + 0.3, ends[1]))
    np.testing.assert_allclose(moved[0, 1, 1], expected + 0.1, atol=ROUNDING)


def test_hybrids_that_cannot_be_trusted_are_not_told():
    """Few draws are where a class would have them; draws that are there are taken instead."""
    own, other = distribution(), distribution(location=[9.0, 1.0], log_sigma=[-0.5])
    bad, good = specimen(), specimen(location=(9.0, 1.0))
    parts = ("material", "noise")
    ends = (0.0, 0.0)
    assert np.isnan(hybrid_evidences([bad], own, other, parts, ends)[1, 0])
    values = hybrid_evidences([bad, good], own, other, parts, ends)
    assert np.isfinite(values).all()


def test_classes_of_unlike_numbers_of_draws_compare():
    """Draws of the two are paired as far as they go, and of very many some are enough."""
    changes = {"location": [0.6, 1.0], "log_sigma": [-0.5]}
    expected, _ = parts_of(distribution(), distribution(**changes))
    for counts in ((50, 20), (600, 50)):
        parts, _ = parts_of(distribution(counts[0]), distribution(counts[1], **changes))
        np.testing.assert_allclose([*parts.values()], [*expected.values()], atol=ROUNDING)


# --- fitted classes -------------------------------------------------------------------------------


def assert_parts(result):
    """The parts of each log ratio add up to it, and are those of the other with the other sign."""
    value, parts = result["log_evidence"].values, result["log_ratio_part"]
    np.testing.assert_allclose(parts.sum("part")[:, 0], value[:, 0] - value[:, 1], atol=1e-9)
    np.testing.assert_array_equal(parts[:, 0], -parts[:, 1])
    assert result["rival"].values.tolist() == [[*NAMES[::-1]]] * len(value)


def test_stiffness_and_noise_of_fitted_classes(tmp_path):
    """Classes that differ in both: soft curves with large noise are soft by one part only."""
    prior = pm.LogNormal.dist(np.log(SIGMA), 0.4)
    classes = fit(sigma=prior, draws=300, chains=1)
    result = classify(curves({"N1": [42.0], "N2": [80.0]}, 3), classes)
    assert_parts(result)
    parts = result["log_ratio_part"]
    assert parts["part"].values.tolist() == ["material", "noise"]
    assert parts.sel(class_label="soft", part="material").values[0] > 0.5
    assert parts.sel(class_label="stiff", part="material").values[1] > 0.5
    # Both classes were measured alike.
    assert np.all(abs(parts.sel(part="noise")) < abs(parts.sel(part="material")))
    result.to_netcdf(tmp_path / "result.nc")


def test_noise_of_fitted_classes():
    """Walls are alike, but for what their curves leave open; what differs is the noise."""
    rng = np.random.default_rng(11)

    def with_noise(data, sd):
        noise = sd * rng.standard_normal(data.sizes["obs"])
        return data.assign(pressure=data["pressure"] + noise)

    moduli = [[40.0, 40.0], [50.0, 50.0], [60.0, 60.0]]
    quiet, loud = (
        with_noise(curves(dict(zip(names, moduli, strict=True)), seed), sd)
        for names, seed, sd in ((["A1", "A2", "A3"], 1, 0.0), (["B1", "B2", "B3"], 2, 3.0))
    )
    prior = pm.LogNormal.dist(np.log(1.0), 1.0)
    classes = fit(training={"quiet": quiet, "loud": loud}, sigma=prior, draws=300, chains=1)
    new = with_noise(curves({"N": [46.0, 46.0]}, 3), 3.0)
    parts = classify(new, classes)["log_ratio_part"].sel(class_label="loud")[0]
    assert parts.sel(part="noise") > 1
    assert abs(parts.sel(part="material")) < parts.sel(part="noise") / 2


@pytest.mark.deep
def test_averages_over_laws_with_and_without_an_experiment_effect():
    """A law without one has the same evidence whosever effect is taken."""
    settings = {"draws": 200, "chains": 1}
    with pytest.MonkeyPatch.context() as patch:
        # Few draws are doubted.
        patch.setattr("pymc_hyperelastic.classes.fit.warn_of_evidence", lambda *_: None)
        without, with_effect = (fit(**settings, experiment_effect=e) for e in (False, True))
    new = curves({"N1": [42.0, 44.0], "N2": [80.0]}, 3)
    result = classify(new, without, average_over=[with_effect])
    assert_parts(result)
    assert result["part"].values.tolist() == ["material", "experiments"]
    labels = ["NeoHookean", "NeoHookean with experiment effect"]
    assert result["strain_energy"].values.tolist() == labels
    assert result.attrs["strain_energy"] == ", ".join(labels)
    laws = result["strain_energy_probability"].values
    assert 0.01 < laws[0] < 0.99  # or the average would be of one
    alone = [classify(new, tree)["log_evidence"].values for tree in (without, with_effect)]
    expected = np.log(laws[0] * np.exp(alone[0]) + laws[1] * np.exp(alone[1]))
    np.testing.assert_allclose(result["log_evidence"].values, expected, atol=0.3)


def test_pooled_classes_of_pressures_have_one_part():
    """It is the log ratio; a class by itself has no rival. Of more signals: test_signals.py."""
    classes = fit(variability="none", draws=200, chains=1)
    result = classify(curves({"N1": [42.0], "N2": [80.0]}, 3), classes)
    assert_parts(result)
    assert result["part"].values.tolist() == ["pressure"]
    one = fit(training={"soft": TRAINING["soft"]}, variability="none", draws=200, chains=1)
    alone = classify(curves({"N1": [42.0]}, 3), one)
    assert not {"rival", "log_ratio_part", "part"} & set(alone.variables)


def test_the_rival_is_the_most_probable_other_class():
    """Of three classes each is held against the best of the others, by what was known before."""
    middle = curves({"C1": [55.0], "C2": [60.0], "C3": [66.0]}, 4)
    training = TRAINING | {"middle": middle}
    classes = fit(training=training, draws=200, chains=1)
    new = curves({"N1": [36.0]}, 3)
    result = classify(new, classes)
    assert result["rival"].values.tolist() == [["middle", "soft", "soft"]]
    prior = {"soft": 0.5, "stiff": 0.5, "middle": 0.0}
    result = classify(new, classes, class_prior=prior)
    assert result["rival"].values.tolist() == [["stiff", "soft", "soft"]]
    value = result["log_evidence"].values[0]
    np.testing.assert_allclose(
        result["log_ratio_part"].sum("part")[0], value - value[[1, 0, 0]], atol=1e-9
    )
    assert isinstance(ph.log_evidence(classes["soft"]), ph.Estimate)
