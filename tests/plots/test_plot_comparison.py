"""plot_comparison: specimens, differences and curves of groups."""

import fits
import numpy as np
import pytest
import xarray as xr

import pymc_hyperelastic as ph


def compare(quantity, **settings):
    classes = fits.fit("neo_hookean_classes")
    few = {"draws": 100, "specimens": 8, "random_seed": 1, "effect_prior": None}
    return ph.compare_classes(classes, quantity, **few, **settings)


@pytest.fixture(scope="module")
def result():
    return compare(["mu", "log_reference_strain"])


def ends_of(line):
    return np.ravel(line["y"])


@pytest.mark.parametrize("contrast", ["difference", "ratio"])
def test_points_and_intervals_are_those_of_the_result(result, contrast):
    figure = ph.plot_comparison(result, backend="none", contrast=contrast)
    typical = result.sel(statistic="typical", comparison="stiff − soft")
    for quantity in ("mu", "log_reference_strain"):
        own, where = typical.sel(quantity=quantity), {"quantity": quantity}
        for i, specimen in enumerate(result["specimen"].values):
            of_one = where | {"specimen": specimen, "group": str(own["specimen_group"][i].values)}
            point, line = (
                figure.get_viz(name, panel="value", **of_one)
                for name in ("specimens", "specimen_interval")
            )
            assert np.ravel(point["y"])[0] == own["specimen_value"][i]
            np.testing.assert_array_equal(ends_of(line), own["specimen_value_interval"][i])
        for group in ("soft", "stiff"):
            point, line = (
                figure.get_viz(name, panel="value", group=group, **where)
                for name in ("groups", "interval")
            )
            of_group = own.sel(group=group)
            assert np.ravel(point["y"])[0] == of_group["value"]
            np.testing.assert_array_equal(ends_of(line), of_group["value_interval"])
        # A logarithm has no ratio: its difference is shown.
        shown = "difference" if quantity != "mu" else contrast
        point, line = (
            figure.get_viz(name, panel="contrast", comparison="stiff − soft", **where)
            for name in ("contrast", "contrast_interval")
        )
        assert np.ravel(point["y"])[0] == own[shown]
        np.testing.assert_array_equal(ends_of(line), own[f"{shown}_interval"])
        nothing = figure.get_viz("nothing", panel="contrast", **where)
        assert nothing["y"] == (shown == "ratio")


def test_no_difference_is_at_the_height_of_the_first_group(result):
    for contrast, scale in (("difference", np.array), ("ratio", np.log)):
        figure = ph.plot_comparison(result, contrast=contrast)
        left, right = (
            figure.get_viz("plot", "estimation", quantity="mu", panel=panel)
            for panel in ("value", "contrast")
        )
        low, high = scale(left.get_ylim())
        first = scale(result["value"].sel(statistic="typical", quantity="mu", group="soft").item())
        np.testing.assert_allclose(scale(right.get_ylim()), [low - first, high - first])
        (words,) = (label.get_text() for label in right.get_xticklabels())
        sign = {"difference": "−", "ratio": "/"}[contrast]
        assert words.startswith(f"stiff {sign} soft\n")


def test_specimens_are_not_shown_beside_spreads(result):
    figure = ph.plot_comparison(result, backend="none", statistic="spread")
    assert "specimens" not in figure.viz
    group = figure.get_viz("groups", panel="value", quantity="mu", group="soft")
    assert np.ravel(group["y"])[0] == result["value"].sel(
        statistic="spread", quantity="mu", group="soft"
    )


def with_a_third_group(result):
    """Return a comparison of three groups: the third one has the numbers of the first."""
    third = result.isel(group=[0]).assign_coords(group=["other"])
    groups = xr.concat([result, third], "group", data_vars="minimal", coords="minimal")
    pairs = [("soft", "stiff"), ("soft", "other"), ("stiff", "other")]
    first, second = zip(*pairs, strict=True)
    return groups.isel(comparison=[0, 0, 0]).assign_coords(
        comparison=[f"{b} − {a}" for a, b in pairs],
        first=("comparison", list(first)),
        second=("comparison", list(second)),
    )


def test_three_groups_have_three_contrasts_on_an_axis_of_their_own(result):
    figure = ph.plot_comparison(with_a_third_group(result))
    right = figure.get_viz("plot", "estimation", quantity="mu", panel="contrast")
    words = [label.get_text().splitlines()[0] for label in right.get_xticklabels()]
    assert words == ["stiff − soft", "other − soft", "other − stiff"]
    assert figure.get_viz("nothing", quantity="mu", panel="value") is None
    ends = result["difference_interval"].sel(statistic="typical", quantity="mu").values.ravel()
    low, high = right.get_ylim()
    assert low < min(0, *ends)
    assert high > max(0, *ends)


def test_lines_connect_the_specimens_of_an_animal():
    animals = {f"{group}{i}": f"animal {i}" for group in "AB" for i in (1, 2, 3)}
    result = compare("mu", pair=animals)
    figure = ph.plot_comparison(result, backend="none")
    for animal in sorted(set(animals.values())):
        line = figure.get_viz("animals", quantity="mu", panel="value", specimen=animal)
        of_animal = result["specimen_value"].isel(specimen=result["animal"] == animal)
        np.testing.assert_array_equal(line["y"], of_animal.values.ravel())


def test_curves_and_bands_equal_the_values_of_the_groups():
    pressure = [1.0, 2.0, 3.0]
    lacking = pytest.warns(UserWarning, match="have no compliance there")
    with pytest.warns(UserWarning, match="extrapolated"), lacking:
        result = compare("compliance", at=pressure)
    figure = ph.plot_comparison(result, backend="none", statistic="mean")
    line, band = (
        figure.get_viz(visual, "compliance", class_label="stiff") for visual in ("median", "band")
    )
    found = result.sel(statistic="mean", group="stiff", quantity="compliance")
    np.testing.assert_allclose(line["x"], pressure)
    np.testing.assert_allclose(line["y"], found["value"])
    for end, bound in (("y_bottom", "low"), ("y_top", "high")):
        np.testing.assert_allclose(band[end], found["value_interval"].sel(bound=bound))
