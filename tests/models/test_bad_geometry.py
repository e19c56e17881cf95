"""Forces, radii, unknown tubes and layers of a model: one error says what was expected."""

import numpy as np
import pymc as pm
import pytest
from bad_input import (
    OGDEN,
    PLACE,
    assert_refused,
    curves,
    fit,
    likelihood,
    model,
    table,
    unknown_curves,
)

import pymc_hyperelastic as ph

SERIES = ph.OgdenSeries(terms=2)
NEO_HOOKEAN = ph.Layer(ph.NeoHookean(), 1.0)
SHARED = pm.Uniform.dist(0, 50), pm.Uniform.dist(0, 50)


def unknown(*names: str, **settings) -> pm.Model:
    """A model in which some of the tube is inferred."""
    priors = {name: pm.Uniform.dist(1, 2) for name in names}
    return model(**{"geometry": priors} | settings)


def layers(*walls, data=None, **settings) -> pm.Model:
    """A model of layers, all of them neo-Hookean but for those given."""
    walls = walls or (NEO_HOOKEAN, NEO_HOOKEAN)
    data = unknown_curves(outer_radius=None) if data is None else data
    return model(data, energy=list(walls), **settings)


# Each row: what is wrong, a call that does it, the error, and fragments that its message must hold.
BAD_INPUT = [
    # Forces, radii, and what is not known of the tube.
    (
        "error of forces that are not there",
        lambda: model(force_sigma=1.0),
        ValueError,
        ["force_sigma", "no axial forces", "'axial_force'"],
    ),
    (
        "error of forces none of which was measured",
        lambda: model(unknown_curves(forces=np.nan), force_sigma=1.0),
        ValueError,
        ["force_sigma", "no axial forces"],
    ),
    (
        "negative error of forces",
        lambda: model(unknown_curves(forces=1.0), force_sigma=-1.0),
        ValueError,
        ["force_sigma is -1.0", "positive", "mN"],
    ),
    (
        "text for an error of forces",
        lambda: model(unknown_curves(forces=1.0), force_sigma="1 mN"),
        TypeError,
        ["force_sigma is '1 mN'", "mN", "distribution"],
    ),
    (
        "error in something else",
        lambda: model(error_in="diameter"),
        ValueError,
        ["error_in is 'diameter'", "'pressure', 'radius'"],
    ),
    (
        "slopes with the error in the radius",
        lambda: model(error_in="radius"),
        ValueError,
        ["slope_weight is 1.0", "error_in='radius'", "expected 0"],
    ),
    (
        "inferred slope weight with the error in the radius",
        lambda: model(error_in="radius", slope_weight=pm.HalfNormal.dist()),
        ValueError,
        ["slope_weight", "error_in='radius'", "expected 0"],
    ),
    (
        "classes with the error in the radius",
        lambda: fit(error_in="radius"),
        TypeError,
        ["error_in"],
    ),
    (
        "unknown radius without a prior",
        lambda: model(unknown_curves(inner_radius=None)),
        ValueError,
        [PLACE, "inner_radius is not known", "geometry={'inner_radius': ...}"],
    ),
    (
        "unknown angle without a prior",
        lambda: unknown("axial_stretch", data=unknown_curves(opening_angle=None)),
        ValueError,
        [PLACE, "opening_angle is not known", "geometry={'opening_angle': ...}"],
    ),
    (
        "unknown radius of a likelihood",
        lambda: likelihood(data=unknown_curves(outer_radius=None)),
        ValueError,
        [PLACE, "outer_radius is not known"],
    ),
    (
        "prior of an unknown measure",
        lambda: unknown("radius"),
        ValueError,
        ["'radius'", "'wall_area'", "'opening_angle'"],
    ),
    (
        "two priors of the outer radius",
        lambda: unknown("inner_radius", "outer_radius", "thickness"),
        ValueError,
        ["['outer_radius', 'thickness']", "one of them"],
    ),
    (
        "thickness without inner radius",
        lambda: unknown("thickness"),
        ValueError,
        ["thickness is inferred together with inner_radius", "outer_radius"],
    ),
    (
        "wall area without inner radius",
        lambda: unknown("wall_area", "axial_stretch"),
        ValueError,
        ["wall_area is inferred together with inner_radius", "outer_radius"],
    ),
    (
        "unknown tube and constant matrices",
        lambda: unknown("inner_radius", mode="collocation"),
        ValueError,
        ["a geometry that is inferred", "mode='quadrature'"],
    ),
    (
        "number for a prior of a radius",
        lambda: model(geometry={"inner_radius": 7.0}),
        TypeError,
        ["'inner_radius' is 7.0", "pm.Uniform.dist(0, 50)"],
    ),
    (
        "a radius a test",
        lambda: model(geometry={"inner_radius": pm.Uniform.dist(6, 7, shape=2)}),
        TypeError,
        ["'inner_radius'", "shape (2,)", "scalar"],
    ),
    (
        "list of geometry",
        lambda: model(geometry=["inner_radius"]),
        TypeError,
        ["geometry must be a dict", "pm.Uniform.dist(0.3, 0.5)", "list"],
    ),
    (
        "likelihood of an unknown measure",
        lambda: likelihood(geometry={"thickness": 2.0}),
        ValueError,
        ["geometry holds 'thickness'", "'outer_radius'"],
    ),
    (
        "likelihood of a list of geometry",
        lambda: likelihood(geometry=[7.0]),
        TypeError,
        ["geometry must be a dict", "list"],
    ),
    # Layers and vectors.
    (
        "priors beside layers",
        lambda: layers(priors={"mu": pm.Uniform.dist(0, 50)}),
        TypeError,
        ["layers take their own priors", "Layer(..., mu=...)"],
    ),
    (
        "layers in a tube with an outer radius",
        lambda: layers(data=curves()),
        ValueError,
        ["layers state the thickness", "outer_radius=None"],
    ),
    (
        "layers and a prior of the outer radius",
        lambda: layers(geometry={"outer_radius": pm.Uniform.dist(8, 9)}),
        ValueError,
        ["layers state the thickness"],
    ),
    ("no layers", lambda: model(energy=[]), TypeError, ["ph.Layer(", "nothing"]),
    (
        "laws for layers",
        lambda: layers(NEO_HOOKEAN, OGDEN),
        TypeError,
        ["ph.Layer(", "Ogden()"],
    ),
    (
        "layers that would share a name",
        lambda: layers(*(ph.Layer(ph.NeoHookean(), 0.5, mu=mu) for mu in SHARED * 2)),
        ValueError,
        ["one name", "'mu'"],
    ),
    (
        "text in a layer",
        lambda: layers(ph.Layer(ph.NeoHookean(), 1.0, mu="stiff")),
        TypeError,
        ["mu_1 is 'stiff'", "a number", "distribution"],
    ),
    (
        "nan in a layer",
        lambda: layers(NEO_HOOKEAN, ph.Layer(ph.NeoHookean(), 1.0, mu=np.nan)),
        TypeError,
        ["mu_2 is nan", "a number"],
    ),
    (
        "a list for a number of a layer",
        lambda: layers(ph.Layer(ph.NeoHookean(), 1.0, mu=[3.0, 4.0])),
        TypeError,
        ["mu_1 is [3.0, 4.0]", "a number"],
    ),
    (
        "a short vector in a layer",
        lambda: layers(ph.Layer(SERIES, 1.0, mu=[3.0])),
        TypeError,
        ["mu_1 is [3.0]", "2 numbers"],
    ),
    (
        "a scalar prior of a vector in a layer",
        lambda: layers(ph.Layer(SERIES, 1.0, mu=pm.Uniform.dist(0, 50))),
        TypeError,
        ["'mu_1'", "shape ()", "2 entries", "shape=2"],
    ),
    (
        "classes of layers",
        lambda: fit({"C1": unknown_curves(outer_radius=None)}, energy=[NEO_HOOKEAN]),
        ValueError,
        ["class 'C1'", "layers", "do not make a class"],
    ),
    (
        "likelihood of layers",
        lambda: likelihood(energy=[NEO_HOOKEAN]),
        TypeError,
        ["ph.Ogden()", "Layer(NeoHookean()"],
    ),
    (
        "scalar prior of a vector",
        lambda: model(energy=SERIES, priors={"mu": pm.Uniform.dist(0, 50)}),
        TypeError,
        ["'mu'", "shape ()", "2 entries", "shape=2"],
    ),
    (
        "prior of a longer vector",
        lambda: model(energy=SERIES, priors={"alpha": pm.Uniform.dist(1, 9, shape=3)}),
        TypeError,
        ["'alpha'", "shape (3,)", "2 entries"],
    ),
    (
        "likelihood of a scalar for a vector",
        lambda: likelihood({"mu": 6.0, "alpha": np.array([2.0, 8.0])}, energy=SERIES),
        TypeError,
        ["'mu'", "2 entries"],
    ),
]


@pytest.mark.parametrize(("call", "error", "fragments"), table(BAD_INPUT))
def test_bad_input(call, error, fragments):
    """Each kind of bad input raises one error that names the place and what was expected."""
    assert_refused(call, error, fragments)
