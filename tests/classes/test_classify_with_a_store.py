"""`classify` gives the same result with and without a store, in batches of any size."""

import warnings

import fits
import numpy as np
import pytest
import xarray as xr
from scipy.special import softmax
from tiers import deep
from variable_classes import classify, curves

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import classification
from pymc_hyperelastic.classes.specimens import SpecimenSampler
from pymc_hyperelastic.data import representatives

# Relative differences between sums of the same terms in another order.
ROUNDING = 1e-6
STUDY = ph.load_dataset("simulated_sheep_aorta")


@pytest.mark.parametrize("by", ["specimen", *deep(["test"])])
def test_classify_gives_the_same_result_with_and_without_a_store(by, tmp_path):
    classes = fits.fit("pooled")
    new = ph.select(STUDY, experiment=3, specimen=["S1", "S4"])
    prior = {"C1": 0.9, "C2": 0.1}
    settings = {"by": by, "class_prior": prior, "random_seed": 3, "progressbar": False}
    store = ph.Store(tmp_path / "store", batch_size=1, cores=1)
    found = ph.classify(new, classes, store=store, **settings).load()
    expected = ph.classify(new, classes, **settings)
    assert found["decision"].values.tolist() == ["C1", "C2"]
    assert set(found.variables) == set(expected.variables) and found.attrs == expected.attrs
    for name in ("class_probability", "log_evidence", "log_evidence_se"):
        np.testing.assert_allclose(found[name], expected[name], rtol=ROUNDING, atol=ROUNDING)
    posterior = softmax(found["log_evidence"] + np.log([*prior.values()]), axis=1)
    np.testing.assert_allclose(found["class_probability"], posterior, rtol=ROUNDING)


def caught(function) -> tuple[xr.Dataset, list[str]]:
    """Return the result of a function, in memory, and its warnings."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        result = function().load()
    return result, [str(warning.message) for warning in found]


def test_failures_and_warnings_are_the_same_with_and_without_a_store(tmp_path, monkeypatch):
    """Two of four specimens fail, and no evidence is reliable; two tests represent all."""
    classes, sample = fits.fit("neo_hookean_classes"), SpecimenSampler.__call__
    specimens = {"N1": [42.0], "N2": [90.0, 91.0], "N3": [60.0], "N4": [75.0]}
    new, batches = curves(specimens, 3), []
    monkeypatch.setattr(representatives, "_MOST", 2)
    monkeypatch.setattr(classification, "LARGEST_PARETO_K", -np.inf)

    def failing(self, data, *args):
        batches.append(data.sizes["test"])
        if {"N2", "N4"} & {*data["specimen"].values.tolist()}:
            raise np.linalg.LinAlgError("singular")
        return sample(self, data, *args)

    monkeypatch.setattr(SpecimenSampler, "__call__", failing)
    expected, said = caught(lambda: classify(new, classes))
    assert said[0].startswith("specimen 'N2', experiment 1 cannot be judged: singular")
    assert "1 of the others" in said[0] and "'error'" in said[0]
    assert said[1].startswith("2 of 4 cannot be judged") and len(said) == 2
    for name, size in (("one", 1), ("three", 3)):
        store = ph.Store(tmp_path / name, cores=1, batch_size=size)
        for times in (1, 0):  # the second call computes nothing and repeats the warnings
            batches.clear()
            found, repeated = caught(lambda s=store: classify(new, classes, store=s))
            xr.testing.assert_equal(found, expected.astype(found.dtypes))
            assert repeated == said and bool(batches) == bool(times)
    backwards = ph.select(new, specimen=["N3", "N1"])
    alone = caught(lambda: classify(backwards, classes))[0]
    xr.testing.assert_equal(alone, expected.sel(specimen=["N1", "N3"]))


def test_store_keeps_the_random_seed_and_refuses_changed_settings(tmp_path):
    classes, new = fits.fit("neo_hookean_classes"), curves({"N1": [42.0]}, 3)
    store = ph.Store(tmp_path / "store", cores=1)
    first = classify(new, classes, store=store, random_seed=None)
    second = classify(new, classes, store=store, random_seed=None)
    xr.testing.assert_identical(first.load(), second.load())
    for settings in ({"random_seed": 5}, {"class_prior": {"soft": 0.4, "stiff": 0.6}}):
        with pytest.raises(ValueError, match="holds other work: "):
            classify(new, classes, store=store, **{"random_seed": None} | settings)
    with pytest.raises(ValueError, match="by is 'specimen' there and 'test' here"):
        classify(new, classes, store=store, by="test", random_seed=None)
