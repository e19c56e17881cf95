"""select keeps the tests of inflation data that have the given labels."""

import numpy as np
import pytest
import xarray as xr
from tables import build, by_diameter, good_frame

from pymc_hyperelastic.data import select as selecting
from pymc_hyperelastic.data.inflation import check_data
from pymc_hyperelastic.data.select import select


def test_selected_tests_keep_their_order_and_points_and_are_renumbered():
    data = by_diameter()
    chosen = select(data, specimen=["S2", "S1"], experiment=1)
    check_data(chosen)
    assert chosen["specimen"].values.tolist() == ["S1", "S2"]
    assert chosen["row"].values.tolist() == [10, 11, 14, 15]
    assert chosen["test"].values.tolist() == [0, 0, 1, 1]
    assert chosen["outer_diameter"].values.tolist() == [20.0, 22.0, 19.8, 21.0]
    assert chosen["test"].attrs == data["test"].attrs
    assert data["test"].values.tolist() == [0, 0, 1, 1, 2, 2]
    xr.testing.assert_identical(select(data), data)


def test_labels_are_compared_as_text():
    data = build(good_frame().assign(specimen=[7, 7, 7, 7, 8, 8]))
    assert select(data, specimen=7).sizes["test"] == 2
    xr.testing.assert_identical(select(data, experiment=np.int64(2)), select(data, experiment="2"))


def test_selected_tests_satisfy_all_conditions():
    data = build().assign_coords(split=("test", ["old", "new", "new"]))
    assert select(data, split="new", group="C1")["row"].values.tolist() == [12, 13]


UNKNOWN = {
    "experiment": ({"experiment": [1, 7]}, "no experiment 7 in the data; there are 1, 2$"),
    "phase": ({"phase": "loading"}, r"do not name a phase, only .*'group'.*give inflation_data"),
    "sex": ({"sex": "f"}, r"do not name a sex, .*data\.assign_coords\(sex=\(\"test\", \[\.\.\."),
    "no specimen": ({"specimen": []}, r"no test with specimen=\[\]"),
    "specimen of another group": (
        {"specimen": "S1", "group": "C2"},
        r"no test with specimen=\['S1'\], group=\['C2'\] in the data; there are "
        "group 'C1', specimen 'S1', experiment 1, 2; group 'C2', specimen 'S2', experiment 1$",
    ),
}


@pytest.mark.parametrize("labels, message", UNKNOWN.values(), ids=UNKNOWN)
def test_unknown_labels_are_refused_with_those_that_exist(labels, message):
    with pytest.raises(ValueError, match=message):
        select(build(), **labels)


def test_tests_at_selects_tests_by_position():
    found = selecting.tests_at(build(), [0, 2])
    xr.testing.assert_identical(found, select(build(), experiment=1))
    assert found["row"].values.tolist() == [10, 11, 14, 15]


def test_data_are_divided_by_specimen_and_specimens_left_out():
    data = build()
    apart = selecting.specimens_apart(data)
    assert [own["row"].values.tolist() for own in apart.values()] == [[10, 11, 12, 13], [14, 15]]
    assert list(selecting.specimens_apart(data, ["S2", "S3"])) == ["S2"]
    xr.testing.assert_identical(selecting.without_specimens(data, ["S1"]), apart["S2"])
