"""Classes without variability: all specimens share one set of parameters, as in the paper.

:class:`PooledClass` fits such classes and predicts new specimens. Fitting, classification,
cross-validation and comparison of classes call it through the interface ``ClassKind``.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, ClassVar

import numpy as np
import pymc as pm
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.classes.interface import (
    ClassKind,
    Fitted,
    Fold,
    Groups,
    Prediction,
    Predictor,
    Seed,
    by_group,
)
from pymc_hyperelastic.classes.pooled_prediction import (
    ClassPredictive,
    particles_of,
    with_hybrids,
)
from pymc_hyperelastic.data.select import specimens_apart, specimens_of, without_specimens
from pymc_hyperelastic.data.variables import kinds_of_tests
from pymc_hyperelastic.evidence.batched import BatchedFunction, without_traces
from pymc_hyperelastic.evidence.keeping import Remember, compute_now
from pymc_hyperelastic.evidence.smc import run_smc, seed_of, seed_sequence
from pymc_hyperelastic.evidence.stored import read_draws, read_numbers, reading
from pymc_hyperelastic.evidence.stored_evidence import check_evidence
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.forward import ForwardModel
from pymc_hyperelastic.models.geometry import split_by_owner
from pymc_hyperelastic.models.inflation import build_model
from pymc_hyperelastic.models.likelihoods import OFFSET_VARIABLES, Likelihood, as_likelihood
from pymc_hyperelastic.models.priors import complete_priors
from pymc_hyperelastic.models.settings import ModelSettings, inflation_data_of
from pymc_hyperelastic.predictions.walls import values_by_draw

Array = NDArray[np.float64]

# Standard error, in nats, from which on the evidence of some of the signals counts as unknown.
_LARGEST_ERROR = 0.5


@dataclass(frozen=True)
class PooledClass(ClassKind):
    """Settings of classes without variability."""

    stored_as: ClassVar[str] = "none"
    has_p_value: ClassVar[bool] = False

    energy: StrainEnergy
    likelihood: Likelihood
    priors: dict[str, Any] | None = None

    @classmethod
    def of_settings(
        cls,
        energy: Any,
        likelihood: Likelihood | Any,
        priors: Mapping[str, Any] | None = None,
    ) -> "PooledClass":
        """Return the kind from arguments of :func:`~pymc_hyperelastic.fit_classes`.

        ValueError if a measure of the tube or the sheet has a prior.
        """
        material, measures = split_by_owner(energy, "priors", priors)
        if measures:
            raise ValueError(
                f"priors holds {next(iter(measures))!r}, a measure of each specimen: this is "
                "possible only with variability='specimen'"
            )
        return cls(energy, as_likelihood(likelihood), material)

    def __post_init__(self) -> None:
        """Refuse a likelihood of observed variables: prediction needs the Potential."""
        if self.likelihood.observed:
            raise ValueError(
                f"likelihood is {self.likelihood!r}; classes without variability need a likelihood "
                "that is a Potential: omit observed=True"
            )

    @classmethod
    def from_settings(cls, settings: ModelSettings) -> "PooledClass":
        """Return the kind of a fitted class from its stored settings."""
        wall, likelihood = settings.make_wall(), settings.make_likelihood()
        if not isinstance(wall, StrainEnergy) or likelihood is None:
            raise ValueError("it has layers, or no likelihood: fit classes with ph.fit_classes")
        if likelihood.observed:
            raise ValueError(
                f"it was sampled with observed variables, {likelihood!r}: fit classes with "
                "ph.fit_classes"
            )
        priors = settings.make_priors()
        complete_priors(wall, priors)
        return cls(wall, likelihood, priors)

    def check_stored(self, fitted: xr.DataTree) -> None:
        """Raise unless a class has its data, an evidence, and draws of all unknowns."""
        data = inflation_data_of(fitted)
        with reading(fitted):
            if lacking := set(self.energy.parameter_names) - set(self.priors or {}):
                raise ValueError(f"its priors lack the parameters {sorted(lacking)}")
            self.check(data)
        check_evidence(fitted)
        posterior = read_draws(fitted, "posterior")
        for p in self.energy.parameters:
            read_numbers(fitted, "posterior", p.name, None)
            with reading(fitted):
                values_by_draw(posterior, p.name, p.size)
        for name in self.likelihood.unknowns:
            read_numbers(fitted, "posterior", name, ("chain", "draw"))
        particles = read_draws(fitted, "unconstrained_posterior")
        for name in map(str, particles.data_vars):
            read_numbers(fitted, "unconstrained_posterior", name, None)

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the signals of the likelihood: each contributes to the evidence."""
        return self.likelihood.signals

    def model(self, data: xr.Dataset) -> pm.Model:
        """Return the PyMC model of a class with these data."""
        return build_model(self.energy, data, self.likelihood, priors=self.priors)

    def settings(self) -> ModelSettings:
        """Return the settings as they are stored in a result."""
        priors = complete_priors(self.energy, self.priors)
        return ModelSettings.of(self.energy, priors, self.likelihood)

    def check(self, data: xr.Dataset, *, partial: bool = False) -> None:
        """Raise unless these data can be modelled with these settings."""
        priors = complete_priors(self.energy, self.priors)
        self.likelihood.check(self.energy, data, priors, partial=partial)

    def fit(
        self,
        groups: Groups,
        draws: int,
        chains: int,
        seed: Seed,
        progressbar: bool = False,
        remember: Remember = compute_now,
    ) -> Iterator[tuple[str, xr.DataTree | Exception]]:
        """Sample the posterior of one class after the other, see ``ClassKind.fit``."""

        def checked_model(data: xr.Dataset) -> pm.Model:
            model = self.model(data)
            model.study.settings()
            return model

        models = by_group(groups, checked_model)
        seeds = seed.generate_state(len(models)).tolist()
        settings = {"draws": draws, "chains": chains, "progressbar": progressbar}
        return self._sampled(models, seeds, remember, **settings)

    def _sampled(
        self, models: dict[str, pm.Model], seeds: list[int], remember: Remember, **settings: Any
    ) -> Iterator[tuple[str, xr.DataTree | Exception]]:
        first = next(iter(models.values()))
        names = [rv.name for rv in first.free_RVs]
        names += [name for name in OFFSET_VARIABLES if name in first.named_vars]
        for i, (name, seed) in enumerate(zip(models, seeds, strict=True)):
            sample = partial(run_smc, models[name], random_seed=seed, var_names=names, **settings)
            try:
                yield name, remember(f"class-{i}", sample)
            except (ValueError, ArithmeticError) as error:
                yield name, error

    def predictor(self, classes: Fitted, like: xr.Dataset, seed: Seed) -> Predictor:
        """Return a function that predicts parts of new data; models are compiled once."""
        self.check(like, partial=True)
        priors = complete_priors(self.energy, self.priors)
        of_all = self.likelihood.forward_model(self.energy, like, priors)
        fitted_classes = [*classes.values()]

        forwards: dict[tuple[bool, bool], ForwardModel] = {}

        def forward_for(data: xr.Dataset) -> ForwardModel:
            kinds = kinds_of_tests(data)
            if kinds not in forwards:
                forwards[kinds] = of_all.with_data(data)
            forwards[kinds].set_data(data)
            return forwards[kinds]

        @cache
        def predictive(
            forward: ForwardModel, number: int, signals: frozenset[str] | None = None
        ) -> ClassPredictive:
            rng = np.random.default_rng(seed_of(seed, f"{number} {sorted(signals or ())}"))
            return self.predictive(fitted_classes[number], forward, rng, signals)

        # Classes that cannot predict raise an error now.
        first = forward_for(next(iter(specimens_apart(like).values())))
        for number in range(len(fitted_classes)):
            predictive(first, number)

        def predict(data: xr.Dataset, seed: Seed) -> list[Prediction]:
            forward = forward_for(data)
            states = seed.generate_state(len(fitted_classes)).tolist()
            predictions = [predictive(forward, i)(state) for i, state in enumerate(states)]

            def evidence_of(number: int, signals: frozenset[str]) -> float:
                try:
                    of_signals = predictive(forward, number, signals)
                    value, error = of_signals(states[number]).log_evidence
                except (ValueError, ArithmeticError):
                    return np.nan
                return value if error < _LARGEST_ERROR else np.nan

            measured = self.likelihood.measured(data)
            return with_hybrids(predictions, self.parts, measured, evidence_of)

        return predict

    @without_traces
    def predictive(
        self,
        fitted: xr.DataTree,
        forward: ForwardModel,
        rng: np.random.Generator,
        signals: Collection[str] | None = None,
    ) -> ClassPredictive:
        """Return the marginal likelihood of the data of a forward model under a fitted class.

        Only these `signals` of the new data are used; all when missing.
        """
        model = self.model(inflation_data_of(fitted))
        sizes = {name: model[name] for name in self.likelihood.unknowns}
        tube = forward.with_variables({name: model[name] for name in self.energy.parameter_names})
        new = self.likelihood.log_likelihood(tube, sizes, signals)
        return ClassPredictive(fitted, model, new, rng)

    def leave_out(
        self, groups: Groups, seed: Seed, remember: Remember = compute_now
    ) -> Callable[[Collection[str], int], Fold]:
        """Return a function that fits all classes without some specimens, and predicts these.

        See ``ClassKind.leave_out``.
        """

        def fold(left_out: Collection[str], draws: int) -> Fold:
            fold_seeds = seed_of(seed, ", ".join(left_out)).spawn(2)
            fit_seed, new_seed = (seed_sequence(s.generate_state(4)) for s in fold_seeds)
            train = {name: without_specimens(data, left_out) for name, data in groups.items()}
            fitted: dict[str, xr.DataTree] = {}
            for name, tree in self.fit(train, draws, 1, fit_seed):
                if isinstance(tree, Exception):
                    raise ValueError(f"class {name!r} cannot be fitted: {tree}") from tree
                fitted[name] = tree
            predictions: dict[str, list[Prediction]] = {}
            for data in groups.values():
                parts = specimens_apart(data, left_out)
                if parts:
                    new_data = without_specimens(data, set(specimens_of(data)[0]) - set(parts))
                    predict = self.predictor(fitted, new_data, new_seed)
                    predictions |= {
                        name: predict(part, seed_of(new_seed, name)) for name, part in parts.items()
                    }
            return Fold.of(fitted, predictions)

        return fold

    def new_specimens(self, fitted: xr.DataTree, rng: np.random.Generator) -> dict[str, Array]:
        """Return posterior draws of the class's parameters, which all its specimens share."""
        posterior = fitted["posterior"].to_dataset().stack(sample=("chain", "draw"))
        return {
            name: posterior[name].transpose("sample", ...).values
            for name in self.energy.parameter_names
        }

    def log_density(self, fitted: xr.DataTree, other: xr.DataTree) -> Array:
        """Return the unnormalised log posterior density of a class at the draws of another one."""
        model = self.model(inflation_data_of(fitted))
        particles = particles_of(other, model)
        columns = [
            values.reshape(values.shape[0] * values.shape[1], -1) for values in particles.values()
        ]
        return BatchedFunction.of_model(model, [model.logp()])(np.concatenate(columns, axis=1))[0]
