"""Data from which a class was learned are refused, and are known again under other names."""

import warnings

import numpy as np
import pytest
import xarray as xr
from variable_classes import TRAINING, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.training import check_left_out


@pytest.fixture(scope="module", params=["none", "specimen"])
def classes(request, tmp_path_factory):
    """Classes of either kind, read back from a file."""
    path = tmp_path_factory.mktemp("classes") / f"{request.param}.nc"
    with pytest.MonkeyPatch.context() as patch:
        # A hundred draws are few, and doubted.
        patch.setattr("pymc_hyperelastic.classes.fit.warn_of_evidence", lambda *_: None)
        fit(variability=request.param, draws=100, chains=1).to_netcdf(path)
    return xr.load_datatree(path)


def renamed(data, *names):
    return data.assign_coords(specimen=("test", list(names)))


@pytest.mark.parametrize("by", ["test", "specimen"])
def test_training_data_are_refused(classes, by):
    """The message names the specimen and the class, for one experiment among new ones too."""
    message = "specimen 'B2', experiment 2: these measurements are in .* class 'stiff'"
    with pytest.raises(ValueError, match=message):
        classify(ph.select(TRAINING["stiff"], specimen="B2", experiment=2), classes, by=by)
    mixed = curves({"N1": [42.0], "N2": [90.0]}, 3).copy(deep=True)
    mixed["pressure"].values[7:] = TRAINING["stiff"]["pressure"].values[7:14]
    with pytest.raises(ValueError, match=r"specimen 'N2', .* class 'stiff', as specimen 'B2'"):
        classify(mixed, classes, by=by)


def test_other_names_do_not_hide_them(classes):
    """Nor does a part of a curve, or mmHg in which it was written."""
    seen = ph.select(TRAINING["soft"], specimen="A2")
    with pytest.raises(ValueError, match=r"specimen 'new', .* class 'soft', as specimen 'A2'"):
        classify(renamed(seen, "new"), classes)
    with pytest.raises(ValueError, match="specimen 'A2'"):
        classify(seen.isel(obs=slice(0, None, 2)), classes)
    converted = seen.assign(pressure=seen["pressure"] / ph.mmHg * ph.mmHg)
    with pytest.raises(ValueError, match="specimen 'A2'"):
        classify(converted, classes)


def test_averages_over_laws_refuse_them_too(classes):
    """All laws were fitted to the same data."""
    with pytest.raises(ValueError, match="training data of class 'soft'"):
        classify(ph.select(TRAINING["soft"], specimen="A1"), classes, average_over=[classes])


def test_other_experiments_on_a_specimen_of_the_class(classes):
    """They are warned of where a specimen is taken for a new one, and are not where none is."""
    again = curves({"A2": [38.0]}, 3)
    variable = classes["soft"].attrs.get("variability") == "specimen"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = classify(again, classes)
    words = [str(w.message) for w in caught if "training data" in str(w.message)]
    assert len(words) == variable
    assert all("['A2'] of class 'soft'" in text for text in words)
    assert all(w.filename == classify.__code__.co_filename for w in caught)
    assert np.isfinite(result["log_evidence"]).all()


def test_copies_of_what_is_left_out_are_refused():
    """A curve under two names would be learned from and asked for; together they may be left."""
    data = {"soft": TRAINING["soft"], "stiff": renamed(TRAINING["soft"], "B1", "B2", "B3")}
    with pytest.raises(ValueError, match=r"specimen 'A1', .* under the specimen 'B1' as well"):
        ph.calibration_report(ph.NeoHookean(), data, sigma=1.0)
    check_left_out(data, {"A1": 1, "B1": 1, "A2": 2, "B2": 2, "A3": 3, "B3": 3})
