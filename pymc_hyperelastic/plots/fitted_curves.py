"""Curves of fitted classes, specimen by specimen, and the data beside them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import (
    at_points,
    check_data,
    evenly_along,
    extension_tests,
    held_stretches,
    points_of,
)
from pymc_hyperelastic.data.select import specimens_apart, tests_at
from pymc_hyperelastic.data.variables import sheet_tests
from pymc_hyperelastic.evidence.results import thinned_draws
from pymc_hyperelastic.mechanics.reference_tube import Tube
from pymc_hyperelastic.mechanics.tube import (
    GEOMETRY,
    current_radius,
    internal_radius_from_outer_radius,
)
from pymc_hyperelastic.models.forward import TubeNumbers
from pymc_hyperelastic.models.likelihoods.errors import Errors
from pymc_hyperelastic.models.settings import (
    holds_inflation_data,
    inflation_data_of,
    model_settings_of,
)
from pymc_hyperelastic.plots.curves import CURVE_POINTS, Array, band_rows
from pymc_hyperelastic.plots.residuals import (
    Points,
    errors_of,
    likelihood_of,
    offsets_of,
    residuals_of,
)
from pymc_hyperelastic.plots.stretches import HELD
from pymc_hyperelastic.plots.style import per_kilopascal
from pymc_hyperelastic.predictions.draws import Draws, draws_of
from pymc_hyperelastic.predictions.measured import typical_tests
from pymc_hyperelastic.predictions.members import specimens_differ
from pymc_hyperelastic.predictions.offsets import knows_offsets
from pymc_hyperelastic.rounding import DIGITS

# Measures of a tube that a posterior may hold. The axial stretch of a curve is that of its test.
_MEASURES = {"inner_radius", "outer_radius", "thickness", "wall_area", "opening_angle"}


class Signal(NamedTuple):
    """A measured quantity that a figure of a fit can show."""

    quantity: str
    """Name of the quantity on the vertical axis."""
    tests: Literal["inflation tests", "extension tests", "tests of sheets"]
    """The tests that are shown."""

    @property
    def of_sheets(self) -> bool:
        """True if tests of sheets are shown, False for those of tubes."""
        return self.tests == "tests of sheets"

    @property
    def over_stretch(self) -> bool:
        """True if the quantity is shown over the axial stretch, False for the radius."""
        return self.tests == "extension tests"

    def has_tests(self, data: xr.Dataset) -> NDArray[np.bool_]:
        """Return True for each test of the kind that is shown."""
        if self.of_sheets or (sheets := sheet_tests(data)).all():
            return sheet_tests(data) & self.of_sheets
        return (extension_tests(data) == self.over_stretch) & ~sheets


# The signals of a fit by name, in the order of a report.
SIGNALS = {
    "pressure": Signal("pressure", "inflation tests"),
    "stiffness": Signal("stiffness", "inflation tests"),
    "axial_force": Signal("axial_force", "inflation tests"),
    "extension_radius": Signal("radius", "extension tests"),
    "extension_force": Signal("axial_force", "extension tests"),
    "stress": Signal("stress", "tests of sheets"),
}


class Specimen(NamedTuple):
    """A specimen in a figure of a fit."""

    label: str
    """Name of its class, or of its group."""
    name: str
    tree: xr.DataTree
    """The fit, with few enough draws for a band."""
    tests: xr.Dataset
    member: str | None
    """Name under which the fit knows the specimen; None if the fit does not know it."""

    @property
    def is_typical(self) -> bool:
        """True if its curves are those of the typical specimen of its class."""
        return self.member is None and specimens_differ(self.tree)


class FittedCurve(NamedTuple):
    """The posterior of one curve of a specimen, and the measured points."""

    test: int
    """Position of the first test on its tube among those of the specimen."""
    band: Array
    """Rows `BAND`."""
    points: Array
    """Rows `POINTS` of the measured values, NaN if not measured."""
    residuals: Array | None
    """Standardised residuals of the points, if the noise is known."""
    less_offset: bool
    """True if the offset of each test is subtracted from its forces."""


def specimens_in(
    classes: Mapping[str, xr.DataTree], data: Mapping[str, xr.Dataset]
) -> tuple[str, list[Specimen]]:
    """Return the specimens of all classes, and the dimension of their labels.

    They are labelled and sorted by class, or by group if there is one class with several groups.
    """
    found = []
    for of_class, tree in classes.items():
        thinned, known = thinned_draws(tree), _known_specimens(tree)
        for name, tests in specimens_apart(data[of_class]).items():
            member = name if name in known else None
            found.append(Specimen(of_class, name, thinned, tests, member))
    groups, dim = [str(one.tests["group"].values[0]) for one in found], "class_label"
    if len(classes) == 1 and len(set(groups)) > 1:
        dim = "group"
        found = [one._replace(label=group) for one, group in zip(found, groups, strict=True)]
    order = list(dict.fromkeys(one.label for one in found))
    return dim, sorted(found, key=lambda one: order.index(one.label))


def _known_specimens(tree: xr.DataTree) -> set[str]:
    """Return the names of the specimens whose parameters, or tubes, the fit holds."""
    if not holds_inflation_data(tree):
        return set()
    posterior = tree["posterior"]
    if specimens_differ(tree) and (
        "experiment_spread" in posterior
        or not ("specimens" in tree.children or "specimen" in posterior.dims)
    ):
        return set()
    return set(specimens_apart(inflation_data_of(tree)))


def data_beside(classes: Mapping[str, xr.DataTree], data: Any) -> dict[str, xr.Dataset]:
    """Inflation data to be shown with each class: given ones, or those it was fitted to."""
    several = isinstance(data, Mapping) and not isinstance(data, xr.Dataset)
    shown = {}
    for name, tree in classes.items():
        if several and name not in data:
            raise ValueError(f"data has nothing for class {name!r}; it has {list(data)}")
        own = data[name] if several else data
        if own is None:
            if not holds_inflation_data(tree):
                raise ValueError(f"{name!r} holds no data of tests: give them as data=...")
            own = inflation_data_of(tree)
        check_data(own)
        shown[name] = own
    return shown


def signals_of(tree: xr.DataTree) -> list[str]:
    """Return the signals that were measured and that the likelihood of a fit used.

    If the fit does not state its likelihood, they are the measured ones without slopes.
    """
    data, likelihood = inflation_data_of(tree), likelihood_of(tree)
    force = likelihood is None or likelihood.with_force
    used = {
        "stiffness": likelihood is not None and likelihood.errors().counts_slopes,
        "axial_force": force and has_forces(data, "axial_force"),
        "extension_force": force and has_forces(data, "extension_force"),
    }
    return [n for n, s in SIGNALS.items() if used.get(n, True) and s.has_tests(data).any()]


def has_forces(data: xr.Dataset, signal: str) -> bool:
    """Return True if axial forces were measured in tests of the kind that a signal shows."""
    if "axial_force" not in data:
        return False
    of_kind = SIGNALS[signal].has_tests(data)[data["test"].values]
    return bool(np.isfinite(data["axial_force"].values[of_kind]).any())


def stretch_labels(
    data: Iterable[xr.Dataset], pressure_unit: str
) -> tuple[list[list[str]], list[str]]:
    """Axial stretches of the tests of some data as figures name them, and all of them in order.

    The label of an extension test names its pressure; these labels are the last.
    """
    labels: list[list[str]] = []
    order: dict[str, tuple[float, float]] = {}
    for dataset in data:
        labels.append([])
        pressures = per_kilopascal(pressure_unit) * dataset["pressure"].values
        extended = extension_tests(dataset)
        for test, stretch in enumerate(held_stretches(dataset).tolist()):
            own, label = pressures[points_of(dataset, test)], "unknown"
            if extended[test]:
                held = np.ptp(own) <= HELD * np.abs(own).max()
                levels = [own.mean()] if held else [own.min(), own.max()]
                at = " to ".join(f"{level:.3g}" for level in levels)
                label = f"varied at {at} {pressure_unit}"
            elif np.isfinite(stretch):
                label = f"{stretch:.4g}"
            order[label] = (stretch if np.isfinite(stretch) else np.inf, float(own.mean()))
            labels[-1].append(label)
    return labels, sorted(order, key=lambda label: order[label])


def tubes_of(data: xr.Dataset) -> NDArray[np.intp]:
    """The number of the tube of each test; tubes that differ by rounding errors are the same."""
    tubes = {name: data[name].values for name in GEOMETRY if name != "axial_stretch"}
    table = pd.DataFrame(tubes | {"axial_stretch": held_stretches(data)}).round(DIGITS)
    return table.groupby(list(GEOMETRY), dropna=False).ngroup().to_numpy()


def curves_of(
    specimen: Specimen, signal: str, energy: Any, ci_prob: float, residuals: bool
) -> Iterator[FittedCurve]:
    """Yield the curves of a specimen, in kPa, mm and mN: of each tube, or of each extension test.

    The radius of a draw in an extension test is that at the measured pressure, or between points.
    """
    shown, tests = SIGNALS[signal], specimen.tests
    by_tube: dict[tuple, Draws] = {}
    chosen = np.flatnonzero(shown.has_tests(tests))
    tubes = np.arange(tests.sizes["test"]) if shown.over_stretch else tubes_of(tests)
    for number in dict.fromkeys(tubes[chosen].tolist()):
        of_tube = chosen[tubes[chosen] == number]
        own = tests_at(tests, of_tube)
        known = _known_tube(specimen, own)
        key = tuple(known.values())
        if key not in by_tube:
            # Draws of a specimen take long, and serve for its tests at all stretches.
            is_known = np.isfinite(at_points(own, "axial_stretch")).all()
            tube = Tube(**known | ({"axial_stretch": 1.0} if is_known else {}))
            by_tube[key] = draws_of(specimen.tree, tube, specimen.member, energy)
        draws = by_tube[key]
        band, draws = _band(signal, own, draws, ci_prob)
        own, points = _at_points(signal, own, draws)
        errors = errors_of(specimen.tree, draws)
        of_force = shown.quantity == "axial_force" and "axial_force" in own
        less_offset = of_force and knows_offsets(specimen.tree)
        if errors is not None and of_force and _has_unknown_offsets(specimen, errors):
            force = own["axial_force"].values - offsets_of(points, errors)
            own, less_offset = own.assign(axial_force=("obs", force)), True
            points = points._replace(tests=own)
        standardised = None
        if residuals and errors is not None and _is_used(signal, own, errors):
            standardised = residuals_of(signal, points, errors)
        measured = _measured(signal, own, points)
        yield FittedCurve(of_tube[0], band, measured, standardised, less_offset)


def _has_unknown_offsets(specimen: Specimen, errors: Errors) -> bool:
    """Return True if tests have offsets that the fit integrated out, and did not store."""
    fitted = specimen.member is not None and not knows_offsets(specimen.tree)
    return fitted and errors.force_offset_sd is not None


def _is_used(signal: str, tests: xr.Dataset, errors: Errors) -> bool:
    """Return True if a signal was measured, and was part of the likelihood."""
    if signal == "stiffness":
        return bool(errors.counts_slopes)
    with_force = errors.force_sd is not None and "axial_force" in tests
    return with_force or SIGNALS[signal].quantity != "axial_force"


def _band(signal: str, tests: xr.Dataset, draws: Draws, ci_prob: float) -> tuple[Array, Draws]:
    """Rows of the band over tests on one tube, and the draws at its axial stretch."""
    x = at_points(tests, quantities_of(signal, tests)[0])
    if SIGNALS[signal].over_stretch:
        grid, pressure = (evenly_along(x, v, CURVE_POINTS) for v in (x, tests["pressure"].values))
        draws = _stretched(draws, grid)
        radius = draws.radius_at(pressure)
        beyond = draws.extrapolated_pressures(pressure, radius, "kPa")
    else:
        grid = np.linspace(x.min(), x.max(), CURVE_POINTS)
        draws = _stretched(draws, held_stretches(tests)[:1])
        radius = _internal_radius(grid, tests, draws.tube)
        beyond = draws.extrapolated_radii(_typical_radius(grid, radius, tests))
    shape = draws.coords["chain"].size, draws.coords["draw"].size, grid.size
    values = np.broadcast_to(_curve(signal, draws.tube, radius), shape)
    if signal == "extension_radius" and "outer_diameter" in tests:
        values = 2 * current_radius(
            draws.tube.geometry["outer_radius"], values, **draws.tube.unloaded
        )
    return band_rows(grid, values, ci_prob, 0.0 if beyond is None else beyond.points), draws


def _curve(signal: str, tube: TubeNumbers, radius: Array) -> Array:
    """Return a signal of tubes at internal radii."""
    if signal == "extension_radius":
        return radius
    if SIGNALS[signal].quantity == "axial_force":
        return tube.axial_force(radius)
    pressure, slope = tube.pressure(radius)
    return slope if signal == "stiffness" else pressure


def _stretched(draws: Draws, stretch: Array) -> Draws:
    """The draws at another axial stretch, or at one for each point, unless it is unknown."""
    if np.isnan(stretch).any():
        return draws
    typical: Any = float(stretch[0]) if stretch.size == 1 else stretch
    tube = draws.tube.stretched(stretch[None, None])
    return draws._replace(tube=tube, typical={**draws.typical, "axial_stretch": typical})


def _typical_radius(grid: Array, radius: Array, tests: xr.Dataset) -> Array:
    """Internal radii for the comparison with the measured range, as the data state these."""
    if radius.ndim == 1:
        return radius
    if not np.isfinite(tests["radius"].values).all():
        return np.nanmedian(radius, axis=(0, 1))
    return np.interp(grid, *np.sort([tests["outer_diameter"].values, tests["radius"].values]))


def _known_tube(specimen: Specimen, tests: xr.Dataset) -> dict[str, Any]:
    """Geometry of a tube without its axial stretch, as the data state it.

    If the fit inferred the tube of this specimen, the geometry is that of the fit.
    """
    settings = model_settings_of(specimen.tree)
    inferred = {*specimen.tree["posterior"].data_vars, *(settings.geometry_sd if settings else ())}
    names = [name for name in GEOMETRY if name != "axial_stretch"]
    if specimen.member is not None and inferred & _MEASURES:
        names = []
    known = {name: float(tests[name].values[0]) for name in names}
    return {name: value for name, value in known.items() if np.isfinite(value)}


def quantities_of(signal: str, tests: xr.Dataset) -> tuple[str, str]:
    """Return the quantities on the horizontal and the vertical axis of a signal of tubes."""
    radius, shown = radius_of(tests), SIGNALS[signal]
    horizontal = "axial_stretch" if shown.over_stretch else radius
    return horizontal, radius if signal == "extension_radius" else shown.quantity


def radius_of(tests: xr.Dataset) -> str:
    """Return which radius was measured: the outer diameter, or the internal radius."""
    return "outer_diameter" if "outer_diameter" in tests else "radius"


def _internal_radius(x: Array, tests: xr.Dataset, tube: TubeNumbers) -> Array:
    """Internal radii, of each draw if outer diameters were measured."""
    if "outer_diameter" not in tests:
        return x
    # A diameter may be too small for the wall of a draw.
    with np.errstate(invalid="ignore"):
        return internal_radius_from_outer_radius(x / 2, **tube.geometry)


def _at_points(signal: str, tests: xr.Dataset, draws: Draws) -> tuple[xr.Dataset, Points]:
    """Tests on the typical tube, and the draws at their points."""
    typical, tube = typical_tests(tests, draws.inferred), draws.tube
    if SIGNALS[signal].over_stretch:
        tube = tube.stretched(at_points(tests, "axial_stretch")[None, None])
    radius = _internal_radius(tests[radius_of(tests)].values, tests, tube)
    return typical, Points(tube, radius, typical, _slopes(typical))


def _slopes(tests: xr.Dataset) -> Array:
    """Central differences of the pressure by the internal radius, kPa/mm; NaN at ends of tests."""
    radius, pressure, test = (tests[name].values for name in ("radius", "pressure", "test"))
    step = radius[2:] - radius[:-2]
    step = np.where((test[2:] == test[:-2]) & (step != 0), step, np.nan)
    slope = np.full_like(pressure, np.nan)
    slope[1:-1] = (pressure[2:] - pressure[:-2]) / step
    return slope


def _measured(signal: str, tests: xr.Dataset, points: Points) -> Array:
    """Rows `POINTS` of the measured values."""
    horizontal, vertical = quantities_of(signal, tests)
    unknown = xr.full_like(tests["pressure"], np.nan)
    values = points.slopes if signal == "stiffness" else tests.get(vertical, unknown).values
    return np.array([at_points(tests, horizontal), values])
