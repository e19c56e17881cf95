"""The parts of a model of inflation curves, and quantities computed from its draws."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import prod
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import describe_test
from pymc_hyperelastic.data.select import specimens_of
from pymc_hyperelastic.data.sheets import sheet_tests
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.results import data_groups
from pymc_hyperelastic.evidence.verdicts import registered_checks
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.checks import CHECKS_OF_CURVES
from pymc_hyperelastic.models.forward import ForwardModel
from pymc_hyperelastic.models.geometry import MeasuredValue, deviation_name
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.models.likelihoods.errors import Errors
from pymc_hyperelastic.models.likelihoods.stresses import stresses_of
from pymc_hyperelastic.models.priors import FEW_DRAWS
from pymc_hyperelastic.models.settings import ModelSettings
from pymc_hyperelastic.quantities import STRESSES

Array = NDArray[np.float64]

registered_checks.append(CHECKS_OF_CURVES)

# Draws of a posterior whose residuals are looked at: the best of these is within about a unit of
# the largest log likelihood.
_SOME = 200


@dataclass(frozen=True)
class Study:
    """Energy, data, priors and likelihood from which a model of inflation curves was made."""

    energy: StrainEnergy | Sequence[Layer]
    data: xr.Dataset
    priors: dict[str, Any]
    likelihood: Likelihood | None = None
    """None for a population, whose specimens have errors of their own."""
    geometry: dict[str, Any] = field(default_factory=dict)
    rising: bool = False
    reference_stress: float | None = None
    """For a population, see :class:`NaturalScale`."""
    forward: ForwardModel | None = None
    """Curves of the model."""

    def __post_init__(self) -> None:
        # Results hold these data: a later change of the caller's Dataset must not reach them.
        object.__setattr__(self, "data", self.data.copy(deep=True))

    def groups(self) -> dict[str, xr.Dataset]:
        """The inflation data, divided as ArviZ does."""
        measured = [name for name in ("pressure", *STRESSES) if name in self.data]
        return {
            "observed_data": self.data[measured].reset_coords(drop=True),
            "constant_data": self.data.drop_vars(measured),
        }

    def result_groups(self, model: pm.Model) -> dict[str, xr.Dataset]:
        """The inflation data, with the present values of the observed variables.

        PyMC's functions may replace the observed data: constant data hold all of the study.
        """
        groups = self.groups()
        if self.likelihood is None or self.likelihood.observed:
            data, observed = self.data.copy(), {}
            for name in map(str, self.data.data_vars):
                if f"{name}_data" in model.named_vars:
                    values = model[f"{name}_data"].get_value()
                    observed[f"measured_{name}"] = model.named_vars_to_dims[f"{name}_data"], values
                    column = data[name].values.astype(float)
                    column[np.isfinite(column)] = values
                    data[name] = data[name].copy(data=column)
            groups = {"observed_data": xr.Dataset(observed), "constant_data": data}
        # Add unknowns that have been observed or set since (pm.observe, pm.do).
        for group, held in data_groups(model).items():
            fixed = [name for name in held.data_vars if name in self._fixed(model)]
            groups[group] = groups[group].merge(held[fixed])
        return groups

    @property
    def physical_ends(self) -> dict[str, tuple[float, float]]:
        """Ends of the physical range of parameters such as angles, by the names of variables."""
        wall = self.energy
        laws = [wall] if isinstance(wall, StrainEnergy) else [layer.energy for layer in wall]
        return {
            name: parameter.prior_range
            for number, law in enumerate(laws, start=1)
            for parameter in law.parameters
            if parameter.natural_scale == "logit"
            for name in (parameter.name, f"{parameter.name}_{number}")
        }

    def diagnostics(
        self, model: pm.Model, posterior: Mapping[str, Array], particles: Array
    ) -> xr.Dataset:
        """Return the error of curves, and their residuals, to be stored with the evidence."""
        error = self.curve_error(posterior)
        found = xr.Dataset({} if np.isnan(error) else {"curve_error": error})
        return found.merge(self.chi_squares_of(model)(self.data, particles))

    def curve_error(self, posterior: Mapping[str, Array]) -> float:
        """Return the largest error of the curves of some draws, see :meth:`ForwardModel.errors`.

        The posterior holds arrays (chain, draw, ...) by name. The error is NaN if a parameter is
        missing there. A geometry that was measured with an error has its measured value.
        """
        if self.forward is None:
            return np.nan
        parameters, geometry = self.forward.unknown
        if not {*parameters, *geometry} <= posterior.keys():
            return np.nan
        # Parameters of a population are by specimen as well.
        axes = 3 if self.likelihood is None else 2
        draws = {k: _some(v.reshape(-1, *v.shape[axes:]), FEW_DRAWS) for k, v in posterior.items()}
        known = ({name: draws[name] for name in names} for names in (parameters, geometry))
        return float(self.forward.errors(self.data, *known).max())

    def residuals(self, model: pm.Model) -> dict[str, Any]:
        """Differences of curves from measured values, in standard deviations of the errors.

        An error of the radius shifts the pressure by the slope of the curve, to first order. Forces
        are left out where radii have errors: their slopes are no variables of the model.
        """
        if self.likelihood is None or self.forward is None:
            return {}
        errors = self.likelihood.errors({name: model[name] for name in self.likelihood.unknowns})
        found: dict[str, Any] = {}
        for part in self.forward.parts:
            # Shared variables follow the data if these are replaced.
            shared = part.share("measured", _measurements_of)
            if not part.of_sheets:
                found |= _residuals_of_tubes(model, errors, shared)
                continue
            sheets: Any = part.with_variables({name: model[name] for name in part.unknown[0]})
            expected = stresses_of(sheets, {name: model[name] for name in STRESSES}, errors)
            found["stress_x"] = (expected.x - shared["stress_x"]) / expected.x_sd
            y = (
                expected.y
                if expected.by_x is None
                else expected.y + expected.by_x * (shared["stress_x"] - expected.x)
            )
            found["stress_y"] = (y - shared["stress_y"]) / expected.y_sd
        return found

    def chi_squares_of(self, model: pm.Model) -> Callable[[xr.Dataset, Array], xr.Dataset]:
        """Compile :meth:`chi_squares` of a model, as a function of its data and of particles.

        The function adds the numbers of material parameters and of measured values.
        The result is empty if the model has no residuals.
        """
        residuals = self.residuals(model)
        if not residuals:
            return lambda *_: xr.Dataset()
        terms = model.replace_rvs_by_values([*residuals.values()])
        function = BatchedFunction.of_model(model, terms)
        shapes = [rv.type.shape for rv in model.free_RVs if rv.name in self.priors]
        parameters = sum(prod(n or 1 for n in shape) for shape in shapes)

        def chi_squares(data: xr.Dataset, particles: Array) -> xr.Dataset:
            values = map(np.asarray, function(_some(particles, _SOME)))
            found = self.chi_squares(data, dict(zip(residuals, values, strict=True)))
            return found.assign(
                parameters=parameters, measured_values=self._count_measured_values(data)
            )

        return chi_squares

    def chi_squares(self, data: xr.Dataset, residuals: Mapping[str, Array]) -> xr.Dataset:
        """Squared residuals and numbers of points by test and signal, of the best of some draws.

        The best offset of each test is subtracted from forces with offsets.
        """
        test, count = data["test"].values, data.sizes["test"]
        offsets = self.likelihood is not None and self.likelihood.with_offset
        members = (test == np.arange(count)[:, None]).astype(float)
        of_sheets, squares, points = sheet_tests(data)[test], {}, {}
        for signal, of_draws in residuals.items():
            there = of_sheets == (signal in STRESSES)
            own = members[:, there] * np.isfinite(data[signal].values[there])
            points[signal] = own.sum(axis=1)
            squares[signal] = np.square(of_draws) @ own.T
            if signal == "axial_force" and offsets:
                squares[signal] -= (of_draws @ own.T) ** 2 / points[signal].clip(1)
                points[signal] = (points[signal] - 1).clip(0)
        best = int(np.argmin(sum(value.sum(axis=1) for value in squares.values())))
        labels = {"signal": [*squares], "test": coords_of(data)["test"]}
        found = {"chi_square": [v[best] for v in squares.values()], "points": [*points.values()]}
        tables = xr.Dataset({name: ([*labels], values) for name, values in found.items()}, labels)
        return tables.transpose("test", "signal")

    def _count_measured_values(self, data: xr.Dataset) -> int:
        """Count the values that the likelihood uses, less one force for each unknown offset."""
        assert self.likelihood is not None
        count = self.likelihood.count(data)
        if self.likelihood.with_offset and "axial_force" in data:
            count -= len(np.unique(data["test"].values[data["axial_force"].notnull().values]))
        return count

    def _fixed(self, model: pm.Model) -> set[str]:
        """Unknowns of the study that are no free variables of a model that was made of its own."""
        unknowns = {*self.priors, *(self.likelihood.unknowns if self.likelihood else ())}
        for name, value in self.geometry.items():
            unknowns.add(deviation_name(name) if isinstance(value, MeasuredValue) else name)
        return unknowns - {rv.name for rv in model.free_RVs}

    def settings(self) -> ModelSettings:
        """Return all that is needed to build the model again; ValueError if it is no class."""
        if not isinstance(self.energy, StrainEnergy) or self.geometry:
            raise ValueError(
                "layers, or a geometry that is inferred, do not make a class whose specimens are "
                "alike: take variability='specimen', or sample them by themselves, "
                "ph.sample_smc(ph.inflation_model(...)), and predict from the result"
            )
        likelihood = self.likelihood
        if self.rising or (likelihood and likelihood.error_in != "pressure"):
            raise ValueError("a class has its error in the pressure, and its prior as it is given")
        return ModelSettings.of(
            self.energy, self.priors, likelihood, reference_stress=self.reference_stress
        )

    def result_attrs(self, model: pm.Model) -> dict[str, str]:
        """Attributes of a result: the whole model, or its law and likelihood if it is no class."""
        try:
            if self._fixed(model):
                raise ValueError("the model has been changed since, and is not that of its priors")
            return self.settings().attrs()
        except ValueError:
            # Sampling a model with a prior of one's own is fine; it cannot serve as a stored class,
            # which `fit_classes` checks before it samples.
            said = {"likelihood_in_words": self.likelihood.in_words} if self.likelihood else {}
        # Evidences of laws are compared under one likelihood, also if priors cannot be stored.
        for likelihood in (None if self._fixed(model) else self.likelihood, None):
            with suppress(ValueError):  # settings of a law, or a prior of an error, are no text
                return said | ModelSettings.of(self.energy, likelihood=likelihood).attrs()
        law = self.energy
        return said | ({"strain_energy": law.name} if isinstance(law, StrainEnergy) else {})


def coords_of(data: xr.Dataset) -> dict[str, Any]:
    """Return the coordinates of the points, tests and specimens of a model of these data."""
    return {
        "obs": np.arange(data.sizes["obs"]),
        "test": [describe_test(data, test) for test in range(data.sizes["test"])],
        "specimen": specimens_of(data)[0],
    } | _coords_of_kinds(data)


def _coords_of_kinds(data: xr.Dataset) -> dict[str, Any]:
    """Return the coordinates of points of tubes, and of sheets, if the data hold both."""
    sheets = sheet_tests(data)
    if sheets.all() or not sheets.any():
        return {}
    at_points = sheets[data["test"].values]
    return {
        "tube_obs": np.flatnonzero(~at_points),
        "sheet_obs": np.flatnonzero(at_points),
        "tube_test": [describe_test(data, int(test)) for test in np.flatnonzero(~sheets)],
    }


def _some(draws: Array, count: int) -> Array:
    return draws[:: -(-len(draws) // count)]


def _measurements_of(data: xr.Dataset) -> dict[str, Array]:
    """Measured quantities of all points; one that was not measured is 0."""
    signals = [name for name in ("pressure", "axial_force", *STRESSES) if name in data]
    return {name: np.nan_to_num(data[name].values.astype(float)) for name in signals}


def _residuals_of_tubes(
    model: pm.Model, errors: Errors, shared: Mapping[str, Any]
) -> dict[str, Any]:
    pressure_sd, radius_sd = errors.pressure_sd, errors.radius_sd
    if radius_sd is not None:
        pressure_sd = 0.0
    elif errors.diameter_sd is not None:
        radius_sd = errors.diameter_sd / 2
    if radius_sd is not None:
        pressure_sd = pt.sqrt(pressure_sd**2 + (radius_sd * model["stiffness"]) ** 2)
    found = {"pressure": (model["pressure"] - shared["pressure"]) / pressure_sd}
    if errors.force_sd is not None and radius_sd is None:
        difference = model["axial_force"] - shared["axial_force"]
        found["axial_force"] = difference / errors.force_sd
    return found
