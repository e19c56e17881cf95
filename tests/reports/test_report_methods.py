"""The methods paragraph and the settings table of a report."""

import json

import pymc as pm
import pytest
from stored_results import DATA, classified, fitted_class, fitted_classes

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics import strain_energy
from pymc_hyperelastic.reports.decisions import show_classified
from pymc_hyperelastic.reports.page import Page
from pymc_hyperelastic.reports.settings import add_methods

ONE = ph.select(DATA, specimen="S1", experiment=1)


def methods(result, show=add_methods):
    page = Page(title="Result")
    page.figure = lambda *_, **__: None
    show(result, page)
    return " ".join(page.methods)


def test_methods_and_settings_describe_pooled_classes_and_versions(write_words):
    page = write_words(fitted_classes())
    for words in (
        "The simulated inflation curves of 5 specimens (3 in C1 and 2 in C2) were analysed: ",
        "10 tests with 200 points",
        "the strain energy Demiray, W = (μ/(2 b)) (e^(b (I₁ − 3)) − 1). All specimens of a class",
        "1.41421 kPa), slope_weight = 0 mm². Priors were Uniform(0, 200) kPa for mu, Uniform(0",
        "by sequential Monte Carlo in 2 independent chains of 100 draws, which also gives",
    ):
        assert words in page.methods
    rows = {row[0]: row[1] for row in page.table("Settings")[1]}
    assert rows["strain energy"] == "Demiray" and rows["prior of mu"] == "Uniform(0, 200) kPa"
    assert rows["draws per chain"] == 100 and rows["chains"] == 2 and rows["random seed"] == "7"
    assert page.methods.endswith("Models were sampled with pymc-hyperelastic 0.0.9 and pymc 6.1.0.")
    assert f"written by pymc_hyperelastic {ph.__version__} on Python" in page.text


@pytest.mark.parametrize(
    ("likelihood", "words"),
    [
        (ph.Gaussian(pm.HalfNormal.dist(1.0)), "Gaussian: pressure_sd inferred, in kPa."),
        (ph.SlopeAugmented(2.0, 3.0), "(a standard deviation of 1.41421 kPa), slope_weight = 3 mm"),
        (ph.Gaussian(1.0, force_sd=1.0, force_offset_sd=3.0), "force_offset_sd = 3 mN."),
    ],
)
def test_methods_state_the_size_of_each_error(likelihood, words):
    found = methods(fitted_class(ONE, "NeoHookean", chains=1, likelihood=likelihood))
    assert words in found
    assert "curves of 1 specimen were analysed: 1 test with 20 points." in found
    inferred = "HalfNormal(0, 1) kPa for pressure_sd"
    assert (inferred in found) == ("inferred" in words)
    assert ("The prior was Uniform(0, 200) kPa for mu." in found) == ("inferred" not in words)


class LawWithoutEquation(ph.StrainEnergy):
    """A user's own law."""

    parameters = ph.NeoHookean.parameters

    def energy(self, radial, hoop, axial, *, mu):
        return mu / 2 * (radial**2 + hoop**2 + axial**2 - 3)


def test_laws_have_an_equation_and_a_law_without_one_is_reported(write_words):
    laws = [getattr(strain_energy, name) for name in strain_energy.__all__]
    for law in laws:
        if isinstance(law, type) and issubclass(law, ph.StrainEnergy) and law.parameters:
            assert law.equation.startswith("W = ")
    page = write_words(fitted_class(ONE, "LawWithoutEquation"))
    assert "with the strain energy LawWithoutEquation. Measurement" in page.methods
    assert ["equation", "not stated"] in page.table("Settings")[1]


def test_prior_named_after_a_function_of_pymc_is_refused(write_words):
    """A file may hold any name: that of a function of PyMC is refused, and not called."""
    for name in ("Model", "sample", "__loader__"):
        tree = fitted_class(ONE, "NeoHookean")
        record = tree.attrs["model_settings"]
        assert '"Uniform"' in record
        tree.attrs["model_settings"] = record.replace('"Uniform"', json.dumps(name))
        page = write_words({"Fit": tree})
        assert "“Settings and versions” of Fit: cannot be shown" in page.warnings
        assert f"is ['{name}', [0.0, 200.0]]; expected [name, parameters]" in page.warnings


def test_methods_state_class_priors_and_decision_limits():
    said = methods(classified(), show_classified)
    assert "All classes had the same prior probability." in said
    assert "No decision" not in said and "none of these" not in said
    prior = json.dumps({"C1": 0.8, "C2": 0.2})
    limits = {"class_prior": prior, "undecided_below": 0.9, "none_below": 0.05}
    said = methods(classified().assign_attrs(limits), show_classified)
    assert "The prior probabilities of the classes were 0.8 for C1 and 0.2 for C2." in said
    assert (
        "No decision was made if the probability of the most probable class was below 0.9." in said
    )
    assert "p-value of every class was below 0.05" in said
