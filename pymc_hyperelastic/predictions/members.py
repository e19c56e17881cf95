"""Select the parameters of one specimen, measured or typical, from a result.

All predictions call :func:`member_of`, through :mod:`~pymc_hyperelastic.predictions.walls`.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.select import specimens_apart, specimens_of
from pymc_hyperelastic.data.sheets import tubes_of
from pymc_hyperelastic.evidence.stored import (
    check_numbers,
    damaged,
    read_draws,
    read_group,
    reading,
)
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.class_distribution import class_posterior, distributions_of
from pymc_hyperelastic.models.geometry import (
    changed_measures,
    of_sheets,
    of_tubes,
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

Array = NDArray[np.float64]

# Name of the typical specimen: the specimen at the location of the class.
TYPICAL = "typical"
#: Seed of random numbers that are the same at every call, such as the draws of a prediction.
SEED = 1
# Variables of the group "specimens" of a fitted class, and their dimensions for one specimen.
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
    """Parameters and tests of one specimen."""

    posterior: xr.Dataset
    """Material parameters, (chain, draw)."""
    data: xr.Dataset | None
    """Tests from which the geometry of the tube is read; None if the result has no data."""
    evidence: xr.Dataset | None
    """Tests to which the parameters were fitted; None if the result has no data."""
    name: str | None
    """Name of the specimen; None if all specimens share one posterior and no name was given."""

    def of_tubes(self) -> "Member":
        """The same without tests of sheets."""
        data, evidence = (None if d is None else tubes_of(d) for d in (self.data, self.evidence))
        return self._replace(data=data, evidence=evidence)


def member_of(tree: xr.DataTree, wall: list[NamedLayer], specimen: str | None) -> Member:
    """Return posterior and data of a specimen; without a name, of the typical specimen.

    If all specimens share one posterior, the name selects the tests only.
    """
    posterior = read_draws(tree, "posterior")
    data = inflation_data_of(tree) if holds_inflation_data(tree) else None
    of_specimen = data if specimen is None else tests_of(data, str(specimen))
    if not specimens_differ(tree):
        posterior = _with_one_tube(posterior, specimen)
        return Member(posterior, of_specimen, data, None if specimen is None else str(specimen))
    if "thickness" in wall[0].values and wall != wall_of(tree):
        raise TypeError(
            "energy is not the one of the model (its layers, or its one strain energy), whose "
            "specimens have separate parameters: leave energy out"
        )
    if specimen is not None:
        posterior = _of_specimen(tree, wall, str(specimen))
        return Member(posterior, of_specimen, of_specimen, str(specimen))
    scale = _scale(tree, wall)
    location = posterior["location"].transpose("coordinate", "chain", "draw")
    return Member(_parameters(scale, location), data, data, TYPICAL)


def _with_one_tube(posterior: xr.Dataset, specimen: str | None) -> xr.Dataset:
    """Select the inferred tube of one specimen; drop all tubes if there are several and no name.

    A tube that was measured with an error is inferred for each specimen.
    """
    if "specimen" not in posterior.dims:
        return posterior
    if specimen is None and posterior.sizes["specimen"] > 1:
        return posterior.drop_dims("specimen")
    place = 0 if specimen is None else _place_of(posterior, str(specimen))
    return posterior.isel(specimen=place, drop=True)


def _place_of(data: xr.Dataset, specimen: str) -> int:
    """Return the index of a specimen along the dimension ``specimen``."""
    names = [str(name) for name in np.ravel(data["specimen"].values).tolist()]
    if specimen not in names:
        raise damaged(data, f"there is no specimen {specimen!r}; there are {names}")
    return names.index(specimen)


def specimens_differ(tree: xr.DataTree) -> bool:
    """Return True if each specimen has separate parameters (classes with variability, populations).

    The location of their distribution then has the dimension ``coordinate``.
    """
    variables = tree["posterior"].data_vars
    return "location" in variables and "coordinate" in variables["location"].dims


def with_parameters(tree: xr.DataTree, specimen: str | None) -> xr.DataTree:
    """Return the result with the parameters of one specimen in its posterior.

    Without a name they are the parameters of the typical specimen, if specimens differ.
    """
    if not specimens_differ(tree):
        if specimen is None:
            return tree
        raise ValueError(f"specimen={specimen!r}: all specimens of this class share one posterior")
    found = member_of(tree, wall_of(tree), specimen).posterior
    rest = tree["posterior"].to_dataset()
    # Replace the variables of all specimens by the variables of this one.
    posterior = found.assign({k: v for k, v in rest.data_vars.items() if k not in found})
    tree = tree.copy()
    tree["posterior"] = xr.DataTree(posterior)
    return tree


def tests_of(data: xr.Dataset | None, specimen: str) -> xr.Dataset:
    """Return the tests of a specimen; raise ValueError if the data have no such specimen."""
    if data is None:
        raise ValueError(f"specimen={specimen!r}: the result holds no data, hence no specimens")
    if specimen not in specimens_of(data)[0]:
        raise ValueError(f"no specimen {specimen!r} in the result; it has {specimens_of(data)[0]}")
    return specimens_apart(data, [specimen])[specimen]


def _scale(tree: xr.DataTree, wall: list[NamedLayer]) -> NaturalScale:
    """Return the natural scale of the coordinates of a class or a population."""
    settings, layered = model_settings_of(tree), "thickness" in wall[0].values
    if settings is None or settings.priors is None:
        missing = "the priors of its layers" if layered else "its reference_stress"
        raise ValueError(
            f"the result does not state {missing}, and the typical specimen cannot be computed "
            "without: give the name of a measured specimen, such as specimen='S1'"
        )
    with reading(tree):
        stated = settings.make_wall() if layered else wall[0].energy
    scale = NaturalScale(stated, settings.reference_stress)
    names = class_posterior(tree)["coordinate"].values.tolist()
    if scale.names != names:
        raise ValueError(
            f"the specimens of the result have the coordinates {names}, but "
            f"{wall[0].energy.name} has {scale.names}: leave energy out, or give the strain "
            "energy of the model"
        )
    return scale


def _of_specimen(tree: xr.DataTree, wall: list[NamedLayer], specimen: str) -> xr.Dataset:
    """Return draws of a measured specimen's parameters, given its curves and its class."""
    posterior = tree["posterior"].to_dataset()
    if "specimen" in posterior.dims:
        return posterior.isel(specimen=_place_of(posterior, specimen), drop=True)
    if "specimens" not in tree.children:
        raise ValueError(
            "the result has no group 'specimens' with draws of each specimen: fit the class again"
        )
    if "experiment_spread" in posterior:
        raise ValueError(
            f"specimen {specimen!r}: the class was fitted with experiment_effect, so that each "
            "experiment has separate parameters; only the typical specimen can be predicted. Leave "
            "specimen out, or use a result of ph.population_model, which has the parameters of "
            "each specimen"
        )
    scale, rng = _scale(tree, wall), np.random.default_rng(SEED)
    draws = stored_draws(tree, specimen)
    if np.isinf(draws.standard_error):
        warn_user(
            f"specimen {specimen!r} was given up during the fit of its class, or its curves are "
            "inaccurate: its draws and all predictions from them may be wrong"
        )
    chosen = np.stack(
        [
            _one_draw_each(draws, posterior.isel(chain=[chain]), rng)
            for chain in range(posterior.sizes["chain"])
        ]
    )
    coordinates = posterior["location"].transpose("coordinate", "chain", "draw")
    found = _parameters(scale, coordinates.copy(data=draws.centre[:, chosen]))
    found = found.assign(_measures_of_draws(tree, specimen, draws.deviations[:, chosen]))
    # Sizes of measurement errors that the class infers for each specimen.
    noises = read_group(tree, "specimens").coords.get("noise", xr.DataArray([])).values.tolist()
    sizes = zip(noises, draws.log_size, strict=False)
    return found.assign({str(n): (("chain", "draw"), np.exp(v[chosen])) for n, v in sizes})


def _measures_of_draws(
    tree: xr.DataTree, specimen: str, deviations: Array
) -> dict[str, tuple[tuple[str, str], Array]]:
    """Return the measures of a specimen that were measured with an error, (chain, draw).

    Those of sheets are relative to the measured value, which the data do not hold.
    """
    settings = model_settings_of(tree)
    errors = settings.geometry_sd if settings else {}
    if len(errors) != len(deviations):
        raise damaged(tree, f"its draws have {len(deviations)} measures, not {[*errors]}")
    by_name = dict(zip(errors, deviations, strict=True))
    found = {name: np.exp(errors[name] * z) for name, z in of_sheets(by_name).items()}
    # Predictions take the axial stretch from the caller or the data, not from a test's deviation.
    z_tubes = {name: z for name, z in of_tubes(by_name).items() if name != "axial_stretch"}
    tests = tubes_of(tests_of(inflation_data_of(tree), specimen))
    if z_tubes and tests is not None:
        measured = tube_of_specimens(tests, of_tubes(errors))
        numbers = {name: values.item() for name, values in measured.items()}
        found |= changed_measures(numbers, z_tubes)
    return {name: (("chain", "draw"), v) for name, v in found.items()}


def names_of_specimens(fitted: xr.DataTree) -> list[str]:
    """Return the names of the specimens in a fitted class."""
    specimens = read_group(fitted, "specimens")
    if "specimen" not in specimens.coords or not specimens.sizes.get("specimen"):
        raise damaged(fitted, "its group 'specimens' has no names of specimens")
    return [str(name) for name in np.ravel(specimens["specimen"].values).tolist()]


def stored_draws(fitted: xr.DataTree, specimen: str) -> SpecimenDraws:
    """Return the stored draws of a specimen; raise ValueError if missing or invalid."""
    names = names_of_specimens(fitted)
    if specimen not in names:
        raise damaged(fitted, f"it has no draws of specimen {specimen!r}; it has draws of {names}")
    of_one = read_group(fitted, "specimens").isel(specimen=names.index(specimen))
    where = f" of specimen {specimen!r}"
    values: dict[str, Any] = {}
    for name, dims in _DRAWS.items():
        # These are empty if the class infers no measurement errors, or has no uncertain tubes.
        empty = name in ("log_size", "deviations") and name in of_one and not of_one[name].size
        if not empty:
            # The standard error is infinite if sampling of the specimen was given up.
            check_numbers(fitted, of_one, name, dims, where, finite=name != "standard_error")
        values[name] = of_one[name].transpose(*dims).values
    if not values["standard_error"] >= 0:
        raise damaged(fitted, f"the 'standard_error'{where} is {values['standard_error']}")
    numbers = {"tests": int(values["tests"]), "standard_error": float(values["standard_error"])}
    return SpecimenDraws(**values | numbers, points=np.empty((of_one.sizes["particle"], 0)))


def _one_draw_each(
    draws: SpecimenDraws, posterior: xr.Dataset, rng: np.random.Generator
) -> NDArray[np.intp]:
    r"""Return the index of one draw of a specimen for each draw ``φ`` of its class's distribution.

    The draw ``x_i`` with importance weight ``w_i`` is chosen with probability
    ``∝ w_i p(x_i | φ)``, from the posterior given the specimen's curves and ``φ``. The pairs are
    then draws of the joint posterior of specimen and distribution.
    """
    distributions = distributions_of(
        xr.DataTree.from_dict({"posterior": posterior}), posterior.sizes["draw"]
    )
    log_weights = draws.log_weight + log_densities(draws, distributions)
    # Gumbel-max trick: the argmax of log weights plus Gumbel noise is a categorical draw.
    return (log_weights + rng.gumbel(size=log_weights.shape)).argmax(axis=1)


def _parameters(scale: NaturalScale, coordinates: xr.DataArray) -> xr.Dataset:
    """Convert natural coordinates, (coordinate, chain, draw), to material parameters."""
    found = posterior_of(scale.numbers(list(coordinates.values)))
    return found.assign_coords({name: coordinates[name] for name in ("chain", "draw")})


def posterior_of(values: Mapping[str, Array]) -> xr.Dataset:
    """Return a posterior with parameters (chain, draw) and vectors (chain, draw, entry)."""
    found = xr.Dataset(
        {
            name: (("chain", "draw", f"{name}_entry")[: value.ndim], value)
            for name, value in values.items()
        }
    )
    return found.assign_coords({n: np.arange(found.sizes[n]) for n in ("chain", "draw")})
