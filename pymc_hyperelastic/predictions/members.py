"""Of whom a prediction is: the typical specimen of a class, or one that was measured."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.select import specimens_apart, specimens_of
from pymc_hyperelastic.evidence.stored import (
    check_numbers,
    damaged,
    read_draws,
    read_group,
    reading,
)
from pymc_hyperelastic.models.class_distribution import class_posterior, distributions_of
from pymc_hyperelastic.models.geometry import (
    deviated_tube,
    tube_of_specimens,
)
from pymc_hyperelastic.models.natural_scale import NaturalScale
from pymc_hyperelastic.models.settings import (
    NamedLayer,
    holds_inflation_data,
    inflation_data_of,
    model_settings_of,
    wall_of,
)
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws, log_densities
from pymc_hyperelastic.predictions.measured import warn_user

Array = NDArray[np.float64]

TYPICAL = "typical"
# Draws of a specimen are the same at every call.
_SEED = 1


# Variables of the group "specimens" of a class, and their dimensions for one specimen.
_DRAWS: dict[str, tuple[str, ...]] = {
    "centre": ("coordinate", "particle"),
    "scatter": ("coordinate", "particle"),
    "log_size": ("noise", "particle"),
    "deviations": ("measure", "particle"),
    "log_weight": ("particle",),
    "tests": (),
    "standard_error": (),
}


class Member(NamedTuple):
    """Whose parameters are meant, and what was measured of them."""

    posterior: xr.Dataset
    """With the material parameters by (chain, draw)."""
    data: xr.Dataset | None
    """Tests that state the tube; None if the result holds none."""
    evidence: xr.Dataset | None
    """Tests that the parameters come from."""
    name: str | None
    """None where specimens do not differ and none was asked for."""


def member_of(tree: xr.DataTree, wall: list[NamedLayer], specimen: str | None) -> Member:
    """Posterior and data of a specimen, or of the typical one where specimens differ."""
    posterior = read_draws(tree, "posterior")
    data = inflation_data_of(tree) if holds_inflation_data(tree) else None
    own = data if specimen is None else tests_of(data, str(specimen))
    if not specimens_differ(tree):
        posterior = _with_one_tube(posterior, specimen)
        return Member(posterior, own, data, None if specimen is None else str(specimen))
    if "thickness" in wall[0].values and wall != wall_of(tree):
        raise TypeError(
            "these are not the layers, or the one strain energy, of specimens that differ: leave "
            "energy out"
        )
    if specimen is not None:
        posterior = _of_specimen(tree, wall, str(specimen))
        return Member(posterior, own, own, str(specimen))
    scale = _scale(tree, wall)
    location = posterior["location"].transpose("coordinate", "chain", "draw")
    return Member(_parameters(scale, location), data, data, TYPICAL)


def _with_one_tube(posterior: xr.Dataset, specimen: str | None) -> xr.Dataset:
    """Posterior with the tube of one specimen; of several, none of which is asked for, with none.

    A tube that was measured with an error is inferred of each specimen.
    """
    if "specimen" not in posterior.dims:
        return posterior
    if specimen is None and posterior.sizes["specimen"] > 1:
        return posterior.drop_dims("specimen")
    place = 0 if specimen is None else _place_of(posterior, str(specimen))
    return posterior.isel(specimen=place, drop=True)


def _place_of(data: xr.Dataset, specimen: str) -> int:
    """Where a specimen stands in a group of a result."""
    names = [str(name) for name in np.ravel(data["specimen"].values).tolist()]
    if specimen not in names:
        raise damaged(data, f"there is no specimen {specimen!r}; there are {names}")
    return names.index(specimen)


def specimens_differ(tree: xr.DataTree) -> bool:
    """Whether each specimen has parameters of its own: a class with variability, a population."""
    variables = tree["posterior"].data_vars
    return "location" in variables and "coordinate" in variables["location"].dims


def with_parameters(tree: xr.DataTree, specimen: str | None) -> xr.DataTree:
    """The result with the parameters of a specimen, or the typical one, in its posterior."""
    if not specimens_differ(tree):
        if specimen is None:
            return tree
        raise ValueError(f"specimen={specimen!r}: all specimens of this class share one posterior")
    found = member_of(tree, wall_of(tree), specimen).posterior
    rest = tree["posterior"].to_dataset()
    # Parameters first; those of all specimens make room for those of one.
    posterior = found.assign({k: v for k, v in rest.data_vars.items() if k not in found})
    tree = tree.copy()
    tree["posterior"] = xr.DataTree(posterior)
    return tree


def tests_of(data: xr.Dataset | None, specimen: str) -> xr.Dataset:
    """Tests of a specimen; ValueError if there are none."""
    if data is None:
        raise ValueError(f"the result holds no data, and knows no specimen {specimen!r}")
    if specimen not in specimens_of(data)[0]:
        raise ValueError(f"no specimen {specimen!r} in the result; it has {specimens_of(data)[0]}")
    return specimens_apart(data, [specimen])[specimen]


def _scale(tree: xr.DataTree, wall: list[NamedLayer]) -> NaturalScale:
    """Coordinates of the specimens of a class or a population."""
    settings, layered = model_settings_of(tree), "thickness" in wall[0].values
    if settings is None or settings.priors is None:
        typical = "the typical specimen"
        unknown = f"{typical} of its layers" if layered else f"its reference_stress, and {typical}"
        raise ValueError(
            f"the result does not state {unknown}: name one that was measured, specimen='S1'"
        )
    with reading(tree):
        stated = settings.make_wall() if layered else wall[0].energy
    scale = NaturalScale(stated, settings.reference_stress)
    names = class_posterior(tree)["coordinate"].values.tolist()
    if scale.names != names:
        raise ValueError(
            f"the result's specimens have the coordinates {names}, those of {wall[0].energy.name} "
            f"would be {scale.names}: leave energy out, or give that of the model"
        )
    return scale


def _of_specimen(tree: xr.DataTree, wall: list[NamedLayer], specimen: str) -> xr.Dataset:
    """Parameters of a specimen that was measured, given its curves and its class."""
    posterior = tree["posterior"].to_dataset()
    if "specimen" in posterior.dims:
        return posterior.isel(specimen=_place_of(posterior, specimen), drop=True)
    if "specimens" not in tree.children:
        raise ValueError("the result holds no draws of its specimens: fit the class again")
    if "experiment_spread" in posterior:
        raise ValueError(
            f"specimen {specimen!r}: with experiment_effect each experiment has parameters of its "
            "own, and of a class predictions of the typical specimen alone are offered, without "
            "specimen=...; a result of ph.population_model has those of each specimen"
        )
    scale, rng = _scale(tree, wall), np.random.default_rng(_SEED)
    draws = stored_draws(tree, specimen)
    if np.isinf(draws.standard_error):
        warn_user(
            f"specimen {specimen!r} was given up after long when its class was fitted, or has "
            "curves that are wrong: its draws, and all predictions by them, may be wrong"
        )
    chosen = np.stack(
        [
            _one_draw_each(draws, posterior.isel(chain=[chain]), rng)
            for chain in range(posterior.sizes["chain"])
        ]
    )
    coordinates = posterior["location"].transpose("coordinate", "chain", "draw")
    found = _parameters(scale, coordinates.copy(data=draws.centre[:, chosen]))
    return found.assign(_tube_of_draws(tree, specimen, draws.deviations[:, chosen]))


def _tube_of_draws(
    tree: xr.DataTree, specimen: str, deviations: Array
) -> dict[str, tuple[tuple[str, str], Array]]:
    """The tube of a specimen by (chain, draw), as far as it was measured with an error."""
    settings = model_settings_of(tree)
    errors = settings.geometry_sd if settings else {}
    if len(errors) != len(deviations):
        raise damaged(tree, f"its draws have {len(deviations)} measures of tubes, not {[*errors]}")
    # A stretch is asked for, and not that of a test.
    by_name = {k: z for k, z in zip(errors, deviations, strict=True) if k != "axial_stretch"}
    if not by_name:
        return {}
    measured = tube_of_specimens(tests_of(inflation_data_of(tree), specimen), errors)
    tube = deviated_tube({name: values.item() for name, values in measured.items()}, by_name)
    tube.pop("axial_stretch")
    return {name: (("chain", "draw"), v) for name, v in tube.items() if np.ndim(v)}


def names_of_specimens(fitted: xr.DataTree) -> list[str]:
    """Names of the specimens of a class."""
    specimens = read_group(fitted, "specimens")
    if "specimen" not in specimens.coords or not specimens.sizes.get("specimen"):
        raise damaged(fitted, "its group 'specimens' names no specimens")
    return [str(name) for name in np.ravel(specimens["specimen"].values).tolist()]


def stored_draws(fitted: xr.DataTree, specimen: str) -> SpecimenDraws:
    """Draws of a specimen as its class stored them; ValueError unless they are sound."""
    names = names_of_specimens(fitted)
    if specimen not in names:
        raise damaged(fitted, f"it has no draws of specimen {specimen!r}, but of {names}")
    of_one = read_group(fitted, "specimens").isel(specimen=names.index(specimen))
    where = f" of specimen {specimen!r}"
    values: dict[str, Any] = {}
    for name, dims in _DRAWS.items():
        # A class may have no inferred errors, and no measures of tubes with errors.
        empty = name in ("log_size", "deviations") and name in of_one and not of_one[name].size
        if not empty:
            # The error of a specimen that was given up is infinite.
            check_numbers(fitted, of_one, name, dims, where, finite=name != "standard_error")
        values[name] = of_one[name].transpose(*dims).values
    if not values["standard_error"] >= 0:
        raise damaged(fitted, f"the 'standard_error'{where} is {values['standard_error']}")
    numbers = {"tests": int(values["tests"]), "standard_error": float(values["standard_error"])}
    return SpecimenDraws(**values | numbers, points=np.empty((of_one.sizes["particle"], 0)))


def _one_draw_each(
    draws: SpecimenDraws, posterior: xr.Dataset, rng: np.random.Generator
) -> NDArray[np.intp]:
    r"""Place of one draw of a specimen for each draw ``φ`` of its class's distribution.

    It is ``x_i`` with the probability ``∝ w_i p(x_i | φ)``, the posterior of the specimen given its
    curves and the distribution: together they are draws of both.
    """
    distributions = distributions_of(
        xr.DataTree.from_dict({"posterior": posterior}), posterior.sizes["draw"]
    )
    log_weights = draws.log_weight + log_densities(draws, distributions)
    # The largest of logarithms with Gumbel noise is one drawn by its weight.
    return (log_weights + rng.gumbel(size=log_weights.shape)).argmax(axis=1)


def _parameters(scale: NaturalScale, coordinates: xr.DataArray) -> xr.Dataset:
    """Material parameters of coordinates by (coordinate, chain, draw)."""
    found = posterior_of(scale.numbers(list(coordinates.values)))
    return found.assign_coords({name: coordinates[name] for name in ("chain", "draw")})


def posterior_of(values: Mapping[str, Array]) -> xr.Dataset:
    """Parameters (chain, draw), and vectors of them (chain, draw, entry), as a posterior."""
    found = xr.Dataset(
        {
            name: (("chain", "draw", f"{name}_entry")[: value.ndim], value)
            for name, value in values.items()
        }
    )
    return found.assign_coords({n: np.arange(found.sizes[n]) for n in ("chain", "draw")})
