"""Base class of likelihoods: checks, storage, words, and the part of a PyMC model."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import lru_cache, reduce
from itertools import compress
from math import sqrt
from operator import add
from typing import Any, ClassVar, Self

import pymc as pm
import xarray as xr
from pytensor.graph.utils import MissingInputError
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import check_data
from pymc_hyperelastic.data.select import warn_of_repeats
from pymc_hyperelastic.data.sheets import sheets_of, tubes_of
from pymc_hyperelastic.data.variables import kinds_of_tests
from pymc_hyperelastic.evidence.stored import is_number
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.models.forward import (
    ForwardModel,
    SymbolicTests,
    forward_model,
    points_of_part,
)
from pymc_hyperelastic.models.geometry import check_tube, of_sheets, of_tubes
from pymc_hyperelastic.models.likelihoods.density import (
    log_likelihood,
    posterior_of_offsets,
    register_measurements,
)
from pymc_hyperelastic.models.likelihoods.errors import SD_OF_SIGMA, SIZES, Errors, check_size
from pymc_hyperelastic.models.likelihoods.slopes import check_slopes
from pymc_hyperelastic.models.likelihoods.stresses import (
    log_likelihood_of_stresses,
    register_stresses,
)
from pymc_hyperelastic.models.priors import (
    check_prior,
    is_inferred,
    positive_draws,
    prior_from_record,
    prior_to_record,
    register_priors,
)

# Variables of a model that hold the posterior moments of each test's offset.
OFFSET_VARIABLES = ("force_offset_mean", "force_offset_error")


@dataclass(frozen=True, repr=False)
class Likelihood:
    """Base class of likelihoods: which quantities were measured, and how large their errors are.

    A subclass is a frozen dataclass whose fields are arguments of :data:`SIZES`, and `observed`.
    """

    observed: bool = field(default=False, kw_only=True)
    force_name: ClassVar[str]
    """Argument that states the error of forces."""

    def __post_init__(self) -> None:
        """Refuse impossible arguments."""
        for argument in fields(self):
            value = getattr(self, argument.name)
            if argument.name in SIZES and (value is not None or argument.default is MISSING):
                check_size(argument.name, value)
        if not isinstance(self.observed, bool):
            raise TypeError(f"observed is {self.observed!r}; expected True or False")
        if "force_offset_sd" in self.sizes and self.force_name not in self.sizes:
            raise ValueError(
                "force_offset_sd is given, but forces have no part in the likelihood: give "
                f"{self.force_name}, {SIZES[self.force_name].expected}, too"
            )

    @property
    def sizes(self) -> dict[str, Any]:
        """Sizes of errors that were given, by argument."""
        given = {f.name: getattr(self, f.name) for f in fields(self) if f.name in SIZES}
        return {name: value for name, value in given.items() if value is not None}

    @property
    def unknowns(self) -> dict[str, TensorVariable]:
        """Distributions among the sizes."""
        return {name: value for name, value in self.sizes.items() if is_inferred(value)}

    @property
    def units(self) -> dict[str, str]:
        """Units of the sizes that were given."""
        return {name: SIZES[name].unit for name in self.sizes}

    def errors(self, values: Mapping[str, Any] | None = None) -> Errors:
        """Return the standard deviations of all errors.

        The `values` are variables of a model by name, in place of distributions.
        """
        sizes = self.sizes | dict(values or {})
        for sigma in SD_OF_SIGMA.keys() & sizes.keys():
            sizes[SD_OF_SIGMA[sigma]] = sizes.pop(sigma) / sqrt(2)
        return Errors(**sizes)

    @property
    def error_in(self) -> str:
        """The quantity that is compared with its measured value: ``"pressure"`` or ``"radius"``."""
        return "radius" if "radius_sd" in self.sizes else "pressure"

    @property
    def with_tubes(self) -> bool:
        """True if pressures of tubes, or their radii, are part of the likelihood."""
        return not {"pressure_sd", "radius_sd", "sigma"}.isdisjoint(self.sizes)

    @property
    def with_sheets(self) -> bool:
        """True if stresses of sheets are part of the likelihood."""
        return "stress_sd" in self.sizes

    @property
    def with_force(self) -> bool:
        """True if axial forces are part of the likelihood."""
        return self.force_name in self.sizes

    @property
    def with_offset(self) -> bool:
        """True if the forces of a test share an offset."""
        return "force_offset_sd" in self.sizes

    @property
    def needs_slopes(self) -> bool:
        """True if slopes of curves are needed, by the likelihood or to propagate an error."""
        errors = self.errors()
        return errors.counts_slopes or not (errors.diameter_sd is errors.stretch_sd is None)

    @property
    def signals(self) -> tuple[str, ...]:
        """Measured quantities in the likelihood; slopes are those of the pressures."""
        used = {
            "pressure": self.with_tubes,
            "slope": self.errors().counts_slopes,
            "force": self.with_force,
            "stress": self.with_sheets,
        }
        return tuple(compress(used, used.values()))

    def count(self, data: xr.Dataset) -> int:
        """Return the number of measured pressures, forces and stresses in the likelihood."""
        columns = ["pressure"] * self.with_tubes + ["axial_force"] * self.with_force
        columns += ["stress_x", "stress_y"] * self.with_sheets
        return sum(int(data[name].notnull().sum()) for name in columns if name in data)

    def measured(self, data: xr.Dataset) -> list[str]:
        """Return the signals that these data have."""
        tubes, sheets = kinds_of_tests(data)
        force = "axial_force" in data and bool(data["axial_force"].notnull().any())
        there = {"pressure": tubes, "slope": tubes, "force": force, "stress": sheets}
        return [name for name in self.signals if there[name]]

    def as_observed(self) -> Self:
        """Return the same likelihood, declared as observed variables."""
        return replace(self, observed=True)

    def check(
        self,
        wall: StrainEnergy | Sequence[Layer],
        data: xr.Dataset,
        parameters: Mapping[str, Any],
        geometry: Mapping[str, Any] | None = None,
        *,
        partial: bool = False,
        together: bool = True,
    ) -> None:
        """Raise unless the data have all that the likelihood of such a tube needs.

        With `partial` the data are those of some specimens: all tests may be of tubes, or of
        sheets, where the likelihood states errors of both, and none may have axial forces. If tests
        of a specimen are used `together`, warn if they are of several phases or cycles.
        """
        if isinstance(wall, StrainEnergy):
            wall.split(parameters)
        for name, size in self.unknowns.items():
            _check_positive(name, size)
        check_data(data)
        tubes, sheets = tubes_of(data), sheets_of(data)
        _check_errors_of(self, tubes, sheets)
        if not partial:
            _check_all_used(self, tubes, sheets, geometry)
            if together:
                warn_of_repeats(data)
        if tubes is not None:
            check_tube(wall, tubes, of_tubes(geometry))
            if not partial:
                self.check_forces(tubes)
            if self.errors().counts_slopes:
                check_slopes(tubes)

    def check_forces(self, tubes: xr.Dataset) -> None:
        """Raise if errors of axial forces are stated, and no force was measured."""
        if self.with_force and "force" not in self.measured(tubes):
            raise ValueError(
                f"{self.force_name} is given, but the data hold no axial forces: add a column "
                f"'axial_force', or leave {self.force_name} away"
            )

    def forward_model(self, *tests: Any, **settings: Any) -> ForwardModel:
        """Return the forward model of the signals: arguments are those of :func:`forward_model`."""
        settings |= {"with_force": self.with_force, "error_in": self.error_in}
        return forward_model(*tests, **settings)

    def register_unknowns(self) -> dict[str, TensorVariable]:
        """Add random variables of the :attr:`unknowns` to the model in context."""
        for name, prior in self.unknowns.items():
            check_prior(name, prior, model=pm.modelcontext(None))
        return register_priors(self.unknowns)

    def register(
        self,
        tests: SymbolicTests,
        curves: Mapping[str, TensorVariable],
        values: Mapping[str, Any],
        dims: str | None = "obs",
    ) -> None:
        """Add the likelihood of tests to the model in context: a Potential or observed variables.

        If forces share an offset, its posterior moments are added, see
        :func:`~pymc_hyperelastic.force_offsets`. The `values` are those of :meth:`errors`, and
        observed variables have the dimension `dims`.
        """
        errors = self.errors(values)
        if not self.observed:
            pm.Potential("likelihood", self.log_likelihood(tests, values))
        for part in tests.parts:
            if self.observed:
                register = register_stresses if part.of_sheets else register_measurements
                register(part, curves, errors, points_of_part(tests, part, dims))
            if self.with_offset and not part.of_sheets:
                moments = posterior_of_offsets(part, curves, errors)
                own = points_of_part(tests, part, pm.modelcontext(None).name_for("test"))
                for name, value in zip(OFFSET_VARIABLES, moments, strict=True):
                    pm.Deterministic(name, value, dims=own)

    def log_likelihood(
        self,
        tests: SymbolicTests,
        values: Mapping[str, Any] | None = None,
        signals: Collection[str] | None = None,
    ) -> TensorVariable:
        """Return the log likelihood of the data of tests, or of some of its signals, a scalar.

        The `values` are those of :meth:`errors`.
        """
        errors, signals = self.errors(values), {*(signals or self.signals)}
        terms = []
        for part in tests.parts:
            if part.of_sheets and "stress" in signals:
                terms.append(log_likelihood_of_stresses(part, errors))
            elif not part.of_sheets and signals - {"stress"}:
                terms.append(log_likelihood(part, errors, signals))
        return reduce(add, terms)

    def to_record(self) -> dict[str, Any]:
        """Return the likelihood in JSON types, with its units.

        ValueError if the parameters of a distribution are not numbers.
        """
        record: dict[str, Any] = {"name": type(self).__name__}
        for name, value in self.sizes.items():
            record[name] = prior_to_record(name, value) if is_inferred(value) else float(value)
        return record | {"observed": self.observed, "units": self.units}

    @staticmethod
    def from_record(record: Any) -> "Likelihood":
        """Return the likelihood of a record of :meth:`to_record`; ValueError if it is none."""
        kinds = {kind.__name__: kind for kind in Likelihood.__subclasses__()}
        name = record.get("name") if isinstance(record, dict) else None
        if not isinstance(name, str) or name not in kinds:
            raise ValueError(
                f"the likelihood is {shown(record)}; expected a record with a name of {[*kinds]}"
            )
        given = {k: v for k, v in record.items() if k not in ("name", "units")}
        known = {argument.name for argument in fields(kinds[name])}
        for key, value in given.items():
            if key not in known:
                raise ValueError(
                    f"a likelihood {name} has the argument {key!r}; expected one of {sorted(known)}"
                )
            if key in SIZES and not is_number(value):
                given[key] = prior_from_record(value, key)
        try:
            likelihood = kinds[name](**given)
        except TypeError as error:
            raise ValueError(f"a likelihood {name} is damaged: {error}") from None
        if record.get("units") != likelihood.units:
            raise ValueError(
                f"a likelihood {name} has the units {shown(record.get('units'))}; expected "
                f"{likelihood.units}"
            )
        return likelihood

    @property
    def in_words(self) -> str:
        """The likelihood and its numbers, for tables and messages."""
        words = []
        for name, value in self.sizes.items():
            unit, inferred = SIZES[name].unit, is_inferred(value)
            size = f"inferred, in {unit}" if inferred else f"= {value:.6g} {unit}"
            size = size.removesuffix(", in 1").removesuffix(" 1") if unit == "1" else size
            if name in SD_OF_SIGMA and inferred:
                size += " (√2 standard deviations)"
            elif name in SD_OF_SIGMA:
                size += f" (a standard deviation of {value / sqrt(2):.6g} {unit})"
            words.append(f"{name} {size}")
        return f"{type(self).__name__}: {', '.join(words)}"

    def __repr__(self) -> str:
        """Return the call that makes the likelihood, distributions as PyMC prints them."""
        arguments = [f"{name}={_text(name, value)}" for name, value in self.sizes.items()]
        arguments += ["observed=True"] * self.observed
        return f"{type(self).__name__}({', '.join(arguments)})"


@lru_cache(maxsize=16)
def _check_positive(name: str, size: TensorVariable) -> None:
    """Raise ValueError if an inferred size has draws that are not positive.

    Densities hold squares of sizes, so that a negative size would count as a second mode. A size
    with a flat prior cannot be drawn, and is not checked.
    """
    with suppress(MissingInputError, NotImplementedError):
        positive_draws(name, size)


def _check_errors_of(
    likelihood: Likelihood, tubes: xr.Dataset | None, sheets: xr.Dataset | None
) -> None:
    """Raise unless the likelihood states errors of the kinds of tests that the data hold."""
    for there, stated, kind, example in (
        (tubes is not None, likelihood.with_tubes, "tubes", "pressure_sd=2 * ph.mmHg"),
        (sheets is not None, likelihood.with_sheets, "sheets", "stress_sd=5.0"),
    ):
        if there and not stated:
            raise ValueError(
                f"the data hold tests of {kind}, and the likelihood {likelihood} states no error "
                f"of them: give ph.Gaussian({example}), or leave these tests out"
            )


def _check_all_used(
    likelihood: Likelihood,
    tubes: xr.Dataset | None,
    sheets: xr.Dataset | None,
    geometry: Mapping[str, Any] | None,
) -> None:
    """Raise if errors, or measures of tubes or sheets, are stated that the data do not need."""
    for part, stated, measures, kind in (
        (tubes, likelihood.with_tubes, of_tubes(geometry), "tube"),
        (sheets, likelihood.with_sheets, of_sheets(geometry), "sheet"),
    ):
        if part is None and stated:
            raise ValueError(
                f"the likelihood {likelihood} states the errors of tests of {kind}s, but the data "
                "hold none: leave these errors away"
            )
        if part is None and measures:
            raise ValueError(
                f"a prior is given for {sorted(measures)[0]!r}, a measure of a {kind}, but the "
                f"data hold no tests of {kind}s: leave it away"
            )


def _text(name: str, value: Any) -> str:
    """Return a size of an error as Python text."""
    if not is_inferred(value):
        return repr(float(value))
    if value.name:  # a variable of a model
        return value.name
    try:
        distribution, parameters, *_ = prior_to_record(name, value)
    except (AttributeError, ValueError):  # an expression, or no univariate distribution
        return "a variable"
    return f"{distribution}({', '.join(f'{p:g}' for p in parameters)})"
