"""Training data are recognised, and refused as new data."""

import warnings

import numpy as np
import pytest
from variable_classes import TRAINING, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.training import check_left_out, check_new, warn_of_copies


def renamed(data, *names):
    return data.assign_coords(specimen=("test", list(names)))


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data,
        lambda data: renamed(data, "new").isel(obs=slice(0, None, 2)),
        lambda data: data.assign(pressure=data["pressure"] / ph.mmHg * ph.mmHg),
    ],
    ids=["as they are", "other name and every second point", "converted units"],
)
def test_training_curve_is_refused_as_new_data(classes, change):
    seen = ph.select(TRAINING["stiff"], specimen="B2", experiment=2)
    with pytest.raises(ValueError, match=r"in .* class 'stiff', as specimen 'B2', experiment 2"):
        check_new(change(seen), classes.children, fresh=True)
    # A curve with one other point is new.
    seen["pressure"].values[0] += 0.001
    check_new(renamed(seen, "new"), classes.children, fresh=True)


def test_one_training_experiment_among_new_ones_is_refused(classes):
    mixed = curves({"N1": [42.0], "N2": [90.0]}, 3)
    mixed["pressure"].values[7:] = TRAINING["stiff"]["pressure"].values[7:14]
    with pytest.raises(ValueError, match=r"specimen 'N2', .* class 'stiff', as specimen 'B2'"):
        classify(mixed, classes)


def test_other_experiments_on_a_training_specimen_warn(classes):
    """If specimens differ, each new specimen counts as an independent draw from its class."""
    again = curves({"A2": [38.0]}, 3)
    with pytest.warns(UserWarning, match=r"\['A2'\] of class 'soft', whose other") as caught:
        classify(again, classes)
    assert caught[0].filename == classify.__code__.co_filename
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_new(again, classes.children, fresh=False)


def test_copy_of_a_left_out_specimen_is_refused_unless_left_out_together():
    """A curve under two names would be in the training data; both may be left out together."""
    data = {"soft": TRAINING["soft"], "stiff": renamed(TRAINING["soft"], "B1", "B2", "B3")}
    with pytest.raises(ValueError, match=r"specimen 'A1', .* under the specimen 'B1' as well"):
        ph.cross_validate(ph.NeoHookean(), data, 1.0)
    check_left_out(data, {"A1": 1, "B1": 1, "A2": 2, "B2": 2, "A3": 3, "B3": 3})


def test_copy_among_the_training_data_warns():
    """A copy under another name counts twice, in one group or in two."""
    soft = TRAINING["soft"]
    copied = renamed(ph.select(soft, specimen="A2"), "B9")
    with pytest.warns(UserWarning, match=r"specimen 'A2', .* under the specimen 'B9' as well"):
        warn_of_copies({"soft": soft, "stiff": copied})
    # No warning, which would be an error: other data, one name, and too few points.
    warn_of_copies(TRAINING)
    warn_of_copies({"soft": soft, "again": soft})
    few = ph.select(soft, specimen="A2", experiment=1).isel(obs=slice(2))
    warn_of_copies({"soft": few, "stiff": renamed(few, "B9")})


def test_fit_warns_of_a_copy_among_the_training_data():
    soft = ph.select(TRAINING["soft"], specimen=["A1", "A2"])
    copied = renamed(soft, *np.char.replace(soft["specimen"].values.astype(str), "A", "B"))
    with pytest.warns(UserWarning, match="would count twice"):
        fit(training={"soft": soft, "stiff": copied}, draws=100, chains=1)
