"""Specimens left out: what an interrupt, odd names and strain energies far apart do to a report."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from interrupts import interrupt
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import pooled
from pymc_hyperelastic.evidence import smc

SEED = 377
SIGMA = 0.5
RADIUS = np.linspace(7.3, 9.0, 7)
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
SPECIMENS = ["1", "2", "3", "4"]


class FixedExponent(ph.StrainEnergy):
    """``W = (mu/a) (λr^a + λθ^a + λz^a - 3)`` with an exponent that is a setting."""

    parameters = (ph.Parameter("mu", r"\mu", "kPa", (0.0, 200.0), "modulus"),)

    def __init__(self, exponent):
        self.exponent = exponent

    def energy(self, radial, hoop, axial, *, mu):
        powers = (stretch**self.exponent for stretch in (radial, hoop, axial))
        return mu / self.exponent * (sum(powers) - 3)


def curves(moduli, law=None):
    """Data of specimens without noise: the modulus of each by its name."""
    law = law or ph.NeoHookean()
    tables = []
    for specimen, mu in moduli.items():
        pressure = ph.inflation_pressure(law, RADIUS, mu=mu, **TUBE).eval(mode="FAST_COMPILE")
        labels = {"specimen": specimen, "experiment": 1}
        tables.append(pd.DataFrame(labels | {"radius": RADIUS, "pressure": pressure}))
    return ph.inflation_data(pd.concat(tables, ignore_index=True), **TUBE)


CLASSES = {"soft": curves({"1": 30.0, "2": 38.0}), "stiff": curves({"3": 95.0, "4": 120.0})}


def report_of(energy=None, classes=None, **settings):
    defaults = {"sigma": SIGMA, "draws": 100, "random_seed": SEED, "progressbar": False}
    defaults |= {"variability": "none"}
    return ph.calibration_report(
        energy or ph.NeoHookean(), classes or CLASSES, **defaults | settings
    )


# What is interrupted, and the call of it that belongs to the second specimen left out.
INTERRUPTS = {
    "second class": (pooled, "run_smc", 4, 1),
    "second chain": (smc, "_temper", 6, 2),
    "classification": (pooled.ClassPredictive, "__call__", 3, 1),
}


@pytest.mark.parametrize(("module", "name", "call", "chains"), INTERRUPTS.values(), ids=INTERRUPTS)
def test_an_interrupt_ends_the_report(monkeypatch, module, name, call, chains):
    """What was known before is kept, and nothing is made of half a fit, nor fitted afterwards."""
    complete = report_of(chains=chains)
    interrupt(monkeypatch, module, name, call)
    with pytest.warns(UserWarning, match="interrupted") as caught:
        report = report_of(chains=chains)
    assert {warning.filename for warning in caught} == {__file__}
    xr.testing.assert_identical(report.isel(specimen=[0]), complete.isel(specimen=[0]))
    for value in ("class_probability", "log_evidence", "log_score", "brier_score"):
        assert np.isnan(report[value].values[:, 1:]).all()


@pytest.mark.parametrize("variability", ["none", *deep(["specimen"])])
def test_specimens_may_be_named_by_numbers(variability):
    """Numbers as names, in the data and in `leave_out`, give the report of the same text."""
    numbered = {
        name: data.assign_coords(specimen=data["specimen"].astype(int))
        for name, data in CLASSES.items()
    }
    pairs = ["a", "b", "a", "b"]
    report = report_of(
        classes=numbered,
        variability=variability,
        leave_out=dict(zip(map(int, SPECIMENS), pairs, strict=True)),
    )
    text = report_of(variability=variability, leave_out=dict(zip(SPECIMENS, pairs, strict=True)))
    assert report["specimen"].values.tolist() == SPECIMENS
    xr.testing.assert_identical(report, text)


@pytest.mark.deep
def test_laws_far_apart_and_laws_of_one_name():
    """A law of no weight is no warning; laws that differ in a setting are labelled with it."""
    right, wrong = FixedExponent(9.0), FixedExponent(2.0)
    classes = {
        "soft": curves({"1": 8.0, "2": 8.2}, right),
        "stiff": curves({"3": 12.0, "4": 12.4}, right),
    }
    report = report_of([right, wrong], classes, sigma=0.05)
    labels = ["FixedExponent(exponent=9.0)", "FixedExponent(exponent=2.0)", "average"]
    assert report["strain_energy"].values.tolist() == labels
    weight = report["strain_energy_probability"].values
    np.testing.assert_array_equal(weight[:2], [[1.0] * 4, [0.0] * 4])
    value = report["log_evidence"].values
    np.testing.assert_array_equal(value[2], value[0])


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"energy": ph.Ogden}, TypeError, r"such as ph\.Ogden\(\) is needed.*call the class"),
        ({"energy": [ph.Ogden]}, TypeError, "call the class"),
        ({"energy": "Ogden"}, TypeError, "is needed, not 'Ogden'"),
        ({"energy": ()}, ValueError, "energy holds no strain energy"),
        ({"experiment_effect": True}, ValueError, "experiment_effect .*variability='specimen'"),
        ({"reference_stress": 30.0}, ValueError, "reference_stress .*variability='specimen'"),
        ({"leave_out": SPECIMENS}, TypeError, "leave_out must be a dict .*not list"),
    ],
)
def test_bad_input_is_named(settings, error, message):
    """One error each, before anything is sampled."""
    energy = settings.get("energy", ph.NeoHookean())
    rest = {name: value for name, value in settings.items() if name != "energy"}
    with pytest.raises(error, match=message):
        ph.calibration_report(energy, CLASSES, sigma=SIGMA, variability="none", **rest)
