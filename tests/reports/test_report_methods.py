"""The methods paragraph and the settings table of a report."""

import json

import numpy as np
import pymc as pm
import pytest
from stored_results import DATA, classified, fitted_class, fitted_classes

import pymc_hyperelastic as ph
from pymc_hyperelastic.reports.blocks import Found
from pymc_hyperelastic.reports.decisions import classified_sentences
from pymc_hyperelastic.reports.laws import in_text
from pymc_hyperelastic.reports.methods import fit_sentences

ONE = ph.select(DATA, specimen="S1", experiment=1)


def methods(tree):
    return " ".join(fit_sentences(Found("Fit", tree)))


def test_methods_settings_and_versions_of_pooled_classes(write_words):
    page = write_words(fitted_classes())
    for words in (
        "The simulated inflation curves of 5 specimens (3 in C1 and 2 in C2) were analysed: ",
        "10 experiments with 200 points",
        "the strain energy Demiray, W = (μ/(2 b)) (e^(b (I₁ − 3)) − 1). All specimens that were",
        "1.414 kPa. Priors were Uniform(0, 200) kPa for mu and Uniform(0, 20) for b. Posteriors ",
        "by sequential Monte Carlo in 2 independent chains of 100 draws each, which also gives",
    ):
        assert words in page.methods
    rows = {row[0]: row[1] for row in page.table("Settings")[1]}
    assert rows["strain energy"] == "Demiray" and rows["prior of mu"] == "Uniform(0, 200) kPa"
    assert rows["draws of a chain"] == 100 and rows["chains"] == 2 and rows["random seed"] == "7"
    versions = {row[0]: row[1:] for row in page.table("Versions")[1]}
    assert versions["pymc-hyperelastic"] == ["0.0.9", ph.__version__]
    assert versions["numpy"] == ["not told", np.__version__]
    software = f"PyTensor {versions['pytensor'][1]} and NumPy {np.__version__}."
    assert page.methods.endswith(f"with pymc_hyperelastic 0.0.9 on PyMC 6.1.0, {software}")


SD, INFERRED = "with a standard deviation", pm.HalfNormal.dist(1.0)


@pytest.mark.parametrize(
    ("likelihood", "sentence"),
    [
        (ph.Gaussian(INFERRED), f"{SD} that was inferred, with the prior Half"),
        (ph.SlopeAugmented(INFERRED, 0.0), f"{SD} times √2 that was inferred, with the prior"),
        (ph.SlopeAugmented(2.0, 3.0), "curves counted too, with a weight of 3 mm²."),
        (
            ph.SlopeAugmented(2.0, 0.0, force_sigma=1.0),
            f"Errors of axial forces were taken as normal, {SD} of 0.7071 mN.",
        ),
        (
            ph.Gaussian(1.0, force_sd=1.0, force_offset_sd=3.0),
            f"offset of the force transducer, normal {SD} of 3 mN.",
        ),
    ],
)
def test_methods_state_the_size_of_each_error(likelihood, sentence):
    found = methods(fitted_class(ONE, "NeoHookean", chains=1, likelihood=likelihood))
    assert sentence in found
    assert "curves of 1 specimen were analysed: 1 experiment with 20 points." in found
    assert ("The prior was Uniform(0, 200) kPa for mu." in found) == ("inferred" not in found)
    assert ("Slopes" in found) == ("weight" in sentence)


def test_latex_fractions_powers_and_indices_become_text():
    assert in_text(r"\frac{a + b}{c} x^{2} - \frac{1}{2}") == "((a + b)/c) x² − (1/2)"
    assert in_text(r"\sum_{i=1}^4 k_2^i \ln\left(λ_θ\right)") == "Σ_(i=1)⁴ k₂ⁱ ln(λ_θ)"


def test_methods_state_class_priors_and_decision_limits():
    said = " ".join(classified_sentences(Found("New", classified())))
    assert "All classes were equally probable beforehand." in said
    assert "undecided" not in said and "none of these" not in said
    prior = json.dumps({"C1": 0.8, "C2": 0.2})
    limits = {"class_prior": prior, "undecided_below": 0.9, "none_below": 0.05}
    said = " ".join(classified_sentences(Found("New", classified().assign_attrs(limits))))
    assert "The probabilities beforehand were 0.8 of C1 and 0.2 of C2." in said
    assert "left undecided where the most probable class had a probability below 0.9." in said
    assert "p-value of every class was below 0.05" in said
