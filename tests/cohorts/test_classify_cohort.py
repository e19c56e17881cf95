"""A cohort is classified as `classify` does it."""

import fits
import numpy as np
import pytest
from scipy.special import softmax
from tiers import deep

import pymc_hyperelastic as ph

# Differences that rounding in another order of sums may make.
ROUNDING = 1e-6


@pytest.mark.parametrize("by", ["specimen", *deep(["test"])])
def test_classify_cohort_gives_the_result_of_classify(by, tmp_path):
    classes = fits.fit("pooled")
    new = ph.select(ph.load_dataset("simulated_sheep_aorta"), experiment=3, specimen=["S1", "S4"])
    prior = {"C1": 0.9, "C2": 0.1}
    settings = {"by": by, "class_prior": prior, "random_seed": 3, "progressbar": False}
    ph.classify_cohort(new, classes, tmp_path / "cohort", batch_size=1, cores=1, **settings)
    found = ph.open_cohort(tmp_path / "cohort").load()
    expected = ph.classify(new, classes, **settings)
    assert found["decision"].values.tolist() == ["C1", "C2"]
    for name in ("class_probability", "log_evidence", "log_evidence_se"):
        np.testing.assert_allclose(found[name], expected[name], rtol=ROUNDING, atol=ROUNDING)
    posterior = softmax(found["log_evidence"] + np.log([*prior.values()]), axis=1)
    np.testing.assert_allclose(found["class_probability"], posterior, rtol=ROUNDING)
