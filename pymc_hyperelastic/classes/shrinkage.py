"""Specimens by their own curves alone, specimens in their class, and new specimens of the class.

:func:`~pymc_hyperelastic.plot_specimens` shows them.
"""

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.classes.compare_classes import check_quantities
from pymc_hyperelastic.classes.joint import draws_given
from pymc_hyperelastic.classes.kinds import kind_of_variable_classes
from pymc_hyperelastic.classes.quantities import complete_conditions, values_of
from pymc_hyperelastic.classes.reference import one_draw
from pymc_hyperelastic.classes.specimen_evidence import unit_of_specimen
from pymc_hyperelastic.evidence.checks import check_fraction
from pymc_hyperelastic.models.class_distribution import distributions_of
from pymc_hyperelastic.predictions.conditions import Conditions
from pymc_hyperelastic.predictions.members import SEED, names_of_specimens, stored_draws

Array = NDArray[np.float64]


def specimens_beside_class(
    classes: xr.DataTree, quantity: str, at: Conditions | Any, ci_prob: float
) -> xr.Dataset:
    """Return the median and an interval of a quantity for the specimens of each class.

    Returns
    -------
    xarray.Dataset
        With the dimension ``point``: lower end, median, upper end.

        ``own``, ``alone`` : each measured specimen (group, specimen), given its curves and its
        class, and given its curves alone under the wide reference distribution of specimens.
        NaN where a class has no specimen of this name.

        ``typical``, ``new`` : the typical specimen of a class, and a new one (group).
    """
    check_fraction("ci_prob", ci_prob)
    kind = kind_of_variable_classes(classes, "plot_specimens shows classes whose specimens differ")
    check_quantities([quantity], [kind])
    at = complete_conditions(classes, [quantity], at, one_pressure=True)
    levels = [(1 - ci_prob) / 2, 0.5, (1 + ci_prob) / 2]
    reference, parts = one_draw(kind.reference), []
    for fitted in classes.children.values():
        distributions = distributions_of(fitted)
        count, size = len(distributions.location[0]), len(kind.scale.names)
        normal = np.random.default_rng(SEED).standard_normal((count, size, 1))
        rows = [np.asarray(distributions.location)[..., 0]]
        rows += [distributions.coordinates(normal)[..., 0]]
        names = names_of_specimens(fitted)
        units = [unit_of_specimen(stored_draws(fitted, n)) for n in names]
        for distribution in (distributions, reference):
            rows += [draws_given(unit, [distribution], count)[0] for unit in units]
        (values,) = values_of(kind, np.stack(rows, axis=-1), [quantity], at).values()
        points = _quantiles(values[0], levels)
        own, alone = np.split(points[2:], 2)
        parts.append(
            xr.Dataset(
                {
                    "typical": ("point", points[0]),
                    "new": ("point", points[1]),
                    "own": (("specimen", "point"), own),
                    "alone": (("specimen", "point"), alone),
                },
                {"specimen": names},
            )
        )
    group = xr.DataArray([*classes.children], dims="group", name="group")
    found = xr.concat(parts, group, join="outer")
    return found.assign_attrs(pressure=at.pressures[0], pressure_unit=at.pressure_unit)


def _quantiles(values: Array, levels: list[float]) -> Array:
    """Quantiles (specimen, level) of draws (draw, specimen); NaN if no draw has a value."""
    found = np.full((values.shape[1], len(levels)), np.nan)
    there = np.isfinite(values).any(axis=0)
    found[there] = np.nanquantile(values[:, there], levels, axis=0).T
    return found
