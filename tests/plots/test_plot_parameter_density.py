"""plot_parameter_density: regions, modes and axes."""

import json

import numpy as np
import xarray as xr
from figures import SEED, hierarchical_class, legend_texts

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.natural_scale import NaturalScale

# The share of 500 draws in a region of one half has a standard error of 2 %, and kernels widen it.
SHARE_TOLERANCE = 0.09
# Relative rounding errors of the ends of an axis.
ROUNDING = 1e-12


def contains(contours, x, y):
    """Return True for points inside a filled contour."""
    inside = np.zeros(len(x), dtype=bool)
    for path in contours.get_paths():
        inside ^= path.contains_points(np.stack([x, y], axis=1))
    return inside


def height_of(area):
    (path,) = [p for p in area.get_paths() if len(p.vertices)]
    return np.ptp(path.vertices[:, 1])


def test_regions_of_both_modes_contain_their_probability(classes):
    figure = ph.plot_parameter_density(classes, ci_probs=[0.5, 0.95])
    assert legend_texts(figure) == ["class C1", "class C2"]
    for name, tree in classes.children.items():
        mu, alpha = (tree["posterior"][n].values.ravel() for n in ("mu", "alpha"))
        for part, mode in enumerate([alpha > 0, alpha < 0]):
            where = {"class_label": name, "y_part": part, "x_part": 0}
            areas = figure.viz["area"]["log_density"].sel(where).values
            for area, prob in zip(areas, (0.95, 0.5), strict=True):
                share = contains(area, mu[mode], alpha[mode]).mean()
                assert abs(share - prob) < SHARE_TOLERANCE
            # A bandwidth of the whole sample would be twenty times as wide as a mode.
            assert height_of(areas[0]) < 6 * alpha[mode].std()


def test_regions_of_a_narrow_bent_ridge_contain_their_probability(classes):
    """A product of two parameters is known to 5 %; each of them is known to a factor of 2."""
    along, across = np.random.default_rng(1).standard_normal((2, 2, 1000))
    mu = np.exp(0.8 * along)
    alpha = 3 / mu * np.exp(0.05 * across)
    tree = classes["C1"].copy(deep=True)
    dims = "chain", "draw"
    tree["posterior"] = xr.Dataset({"mu": (dims, mu), "alpha": (dims, alpha)})
    figure = ph.plot_parameter_density(tree, ci_probs=[0.5, 0.95])
    areas = figure.viz["area"]["log_density"].values.ravel()
    for area, prob in zip(areas, (0.95, 0.5), strict=True):
        assert abs(contains(area, mu.ravel(), alpha.ravel()).mean() - prob) < 0.05


def test_axis_is_broken_only_between_mirrored_modes(classes):
    swapped = ph.plot_parameter_density(classes, var_names=["alpha", "mu"], backend="none")
    assert dict(swapped.viz["plot"].sizes) == {"y_part": 1, "x_part": 2}
    # A few draws in another mode have no panel.
    tree = classes["C1"].copy(deep=True)
    posterior = abs(tree["posterior"].to_dataset())
    posterior["alpha"][0, :2] *= -1
    tree["posterior"] = posterior
    figure = ph.plot_parameter_density(tree)
    assert dict(figure.viz["plot"].sizes) == {"y_part": 1, "x_part": 1}
    area = figure.viz["area"]["log_density"].values.ravel()[0]
    assert height_of(area) < 6 * posterior["alpha"].values[0, 2:].std()


def test_regions_end_at_the_limit_of_a_uniform_prior(classes):
    tree = classes["C1"].copy(deep=True)
    pile = 40 - np.random.default_rng(SEED).exponential(1.0, size=(2, 500))
    tree["posterior"] = tree["posterior"].to_dataset().assign(alpha=(("chain", "draw"), pile))
    figure = ph.plot_parameter_density(tree)
    area = figure.viz["area"]["log_density"].sel(y_part=0, x_part=0).values.ravel()[0]
    top = max(path.vertices[:, 1].max() for path in area.get_paths())
    assert 39.9 < top <= 40 * (1 + ROUNDING)


def test_regions_of_a_modulus_without_a_known_prior_end_at_0(classes):
    tree = classes["C1"].copy(deep=True)
    pile = np.random.default_rng(SEED).exponential(1.0, size=(2, 500))
    tree["posterior"] = tree["posterior"].to_dataset().assign(stiffness=(("chain", "draw"), pile))
    tree.attrs["units"] = json.dumps({"stiffness": "kPa"})
    figure = ph.plot_parameter_density(tree, var_names=["mu", "stiffness"])
    area = figure.viz["area"]["log_density"].sel(y_part=0, x_part=0).values.ravel()[0]
    bottom = min(path.vertices[:, 1].min() for path in area.get_paths())
    assert 0 <= bottom < 0.1


def test_dashed_line_contains_its_share_of_new_specimens():
    tree, members = hierarchical_class(0.2)
    figure = ph.plot_parameter_density(tree, ci_probs=[0.5, 0.8])
    (line,) = figure.viz["new"]["log_density"].values.ravel()
    values = NaturalScale(ph.Ogden()).numbers(list(members))
    points = np.stack([values["mu"], values["alpha"]], axis=1)
    inside = np.logical_or.reduce([path.contains_points(points) for path in line.get_paths()])
    # The share of 1000 draws has a standard error of 1.3 %; kernels widen the region.
    assert abs(inside.mean() - 0.8) < 0.06
    filled = figure.viz["area"]["log_density"].values.ravel()[0].get_paths()[0]
    assert np.ptp(filled.vertices[:, 0]) < 0.6 * np.ptp(line.get_paths()[0].vertices[:, 0])
    assert legend_texts(figure) == ["typical specimen", "new specimen, 80 %"]
    axes = figure.get_viz("plot", "log_density")
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "linear")
    # Wide axes are logarithmic, and the region fills them.
    figure = ph.plot_parameter_density(hierarchical_class(1.5)[0])
    axes = figure.get_viz("plot", "log_density")
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    (line,) = figure.viz["new"]["log_density"].values.ravel()
    corners = np.concatenate([path.vertices for path in line.get_paths() if len(path.vertices)])
    for ends, place in zip((axes.get_xlim(), axes.get_ylim()), corners.T, strict=True):
        assert np.ptp(np.log(place)) > 0.5 * np.ptp(np.log(ends))
