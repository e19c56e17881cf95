"""Classes without variability: all specimens share one set of parameters, as in the paper.

:class:`Pooled` fits such classes, and :class:`ClassPredictive` computes the marginal likelihood of
new data under them. Fitting, classification, cross-validation and comparison of classes call them
through the interface ``ClassKind``.
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
    Data,
    Fitted,
    Fold,
    Prediction,
    Predictor,
    Seed,
    training_evidence,
)
from pymc_hyperelastic.classes.signals import with_hybrids
from pymc_hyperelastic.data.select import specimens_apart, specimens_of, without_specimens
from pymc_hyperelastic.evidence.batched import BatchedFunction, value_shapes, without_traces
from pymc_hyperelastic.evidence.diagnosis import worst_verdict
from pymc_hyperelastic.evidence.estimate import Estimate, combine_chains
from pymc_hyperelastic.evidence.importance import (
    LARGEST_PARETO_K,
    STEP_DRAWS,
    importance_sampling,
    mean_weight,
    weighted_draws,
)
from pymc_hyperelastic.evidence.keeping import Remember, compute_now
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.mixture import GaussianMixture, components_for
from pymc_hyperelastic.evidence.modes import find_modes
from pymc_hyperelastic.evidence.proposal import expectation_maximisation
from pymc_hyperelastic.evidence.smc import run_smc, seed_of, seed_sequence
from pymc_hyperelastic.evidence.stored import damaged, read_draws, read_numbers, reading
from pymc_hyperelastic.evidence.stored_evidence import check_evidence
from pymc_hyperelastic.evidence.target import Score, gradient_by_differences, width_of
from pymc_hyperelastic.evidence.weights import effective_sample_size
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.forward import ForwardModel
from pymc_hyperelastic.models.inflation import tube_model
from pymc_hyperelastic.models.likelihoods import OFFSET_VARIABLES, Likelihood, as_likelihood
from pymc_hyperelastic.models.priors import complete_priors
from pymc_hyperelastic.models.settings import ModelSettings, inflation_data_of
from pymc_hyperelastic.predictions.walls import values_by_draw

Array = NDArray[np.float64]

# Largest number of draws of a class to which a mixture is fitted.
_MIXTURE_DRAWS = 4000
# Number of draws from this mixture for the normaliser of the class's posterior.
_NORMALISER_DRAWS = 20000
# Number of class draws at which the likelihood of new data is computed first.
_TRIAL_DRAWS = 200
# Fewest effective draws among these for which the likelihood at all class draws is computed.
_FEWEST_EFFECTIVE_TRIALS = 10
# Number of draws from the proposal at the modes, which is tried before a proposal is adapted.
_CANDIDATE_DRAWS = 1500
# Fraction of these draws that comes from the mixture of the class, in case modes are missing.
_CLASS_SHARE = 0.1
# Standard error, in nats, from which on the evidence of some of the signals counts as unknown.
_LARGEST_ERROR = 0.5


@dataclass(frozen=True)
class Pooled(ClassKind):
    """Settings of classes without variability."""

    variability: ClassVar[str] = "none"
    has_p_value: ClassVar[bool] = False

    energy: StrainEnergy
    likelihood: Likelihood
    priors: dict[str, Any] | None = None

    @classmethod
    def of_settings(
        cls,
        energy: StrainEnergy,
        likelihood: Likelihood | Any,
        *,
        priors: dict[str, Any] | None = None,
        geometry: Mapping[str, Any] | None = None,
        experiment_effect: bool = False,
        reference_stress: float | None = 20.0,
    ) -> "Pooled":
        """Return the kind; arguments for classes with variability must have their defaults."""
        only = "this argument can be used only with variability='specimen'"
        if geometry:
            raise ValueError(f"geometry is {geometry!r}: {only}")
        if experiment_effect:
            raise ValueError(f"experiment_effect is {experiment_effect!r}: {only}")
        if reference_stress != 20.0:
            raise ValueError(f"reference_stress is {reference_stress!r}: {only}")
        return cls(energy, as_likelihood(likelihood), priors)

    def __post_init__(self) -> None:
        """Refuse a likelihood of observed variables: prediction needs the Potential."""
        if self.likelihood.observed:
            raise ValueError(
                f"likelihood is {self.likelihood!r}; classes without variability need a likelihood "
                "that is a Potential: omit observed=True"
            )

    @classmethod
    def from_settings(cls, settings: ModelSettings) -> "Pooled":
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
        return tube_model(self.energy, data, self.likelihood, priors=self.priors)

    def settings(self) -> ModelSettings:
        """Return the settings as they are stored in a result."""
        priors = complete_priors(self.energy, self.priors)
        return ModelSettings.of(self.energy, priors, self.likelihood)

    def check(self, data: xr.Dataset) -> None:
        """Raise unless these data can be modelled with these settings."""
        self.likelihood.check(self.energy, data, complete_priors(self.energy, self.priors))

    def fit(
        self,
        classes: Data,
        draws: int,
        chains: int,
        seed: Seed,
        progressbar: bool = False,
        remember: Remember = compute_now,
    ) -> Iterator[tuple[str, xr.DataTree | Exception]]:
        """Sample the posterior of one class after the other, see ``ClassKind.fit``."""
        models = {}
        for name, data in classes.items():
            try:
                models[name] = self.model(data)
                models[name].study.settings()
            except (TypeError, ValueError) as error:
                raise type(error)(f"class {name!r}: {error}") from error
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
        """Return a function that predicts parts of new data; it compiles everything here, once."""
        self.check(like)
        priors = complete_priors(self.energy, self.priors)
        forward = self.likelihood.forward_model(self.energy, like, priors)
        rng = np.random.default_rng(seed)
        fitted_classes = [*classes.values()]
        predictives = [ClassPredictive(fitted, self, forward, rng) for fitted in fitted_classes]

        @cache
        def predictive_of_signals(number: int, signals: frozenset[str]) -> ClassPredictive:
            rng = np.random.default_rng(seed_of(seed, f"{number} {sorted(signals)}"))
            return ClassPredictive(fitted_classes[number], self, forward, rng, signals)

        def predict(data: xr.Dataset, seed: Seed) -> list[Prediction]:
            forward.set_data(data)
            states = seed.generate_state(len(predictives)).tolist()
            predictions = [p(state) for p, state in zip(predictives, states, strict=True)]

            def evidence_of(number: int, signals: frozenset[str]) -> float:
                try:
                    predictive = predictive_of_signals(number, signals)
                    value, error = predictive(states[number]).log_evidence
                except (ValueError, ArithmeticError):
                    return np.nan
                return value if error < _LARGEST_ERROR else np.nan

            measured = self.likelihood.measured(data)
            return with_hybrids(predictions, self.parts, measured, evidence_of)

        return predict

    def leave_out(
        self, classes: Data, seed: Seed, remember: Remember = compute_now
    ) -> Callable[[Collection[str], int, int], Fold]:
        """Return a function that fits all classes without some specimens, and predicts these.

        See ``ClassKind.leave_out``.
        """

        def fold(left_out: Collection[str], draws: int, chains: int) -> Fold:
            fold_seeds = seed_of(seed, ", ".join(left_out)).spawn(2)
            fit_seed, new_seed = (seed_sequence(s.generate_state(4)) for s in fold_seeds)
            train = {name: without_specimens(data, left_out) for name, data in classes.items()}
            fitted: dict[str, xr.DataTree] = {}
            for name, tree in self.fit(train, draws, chains, fit_seed):
                if isinstance(tree, Exception):
                    raise ValueError(f"class {name!r} cannot be fitted: {tree}") from tree
                fitted[name] = tree
            if any(tree["evidence"].sizes["chain"] < chains for tree in fitted.values()):
                # After an interrupt the sampler returns fewer chains: a fold needs all of them.
                raise KeyboardInterrupt
            predictions: dict[str, list[Prediction]] = {}
            for data in classes.values():
                parts = specimens_apart(data, left_out)
                if parts:
                    new_data = without_specimens(data, set(specimens_of(data)[0]) - set(parts))
                    predict = self.predictor(fitted, new_data, new_seed)
                    predictions |= {
                        name: predict(part, seed_of(new_seed, name)) for name, part in parts.items()
                    }
            return Fold(training_evidence(fitted), worst_verdict(fitted.values()), predictions)

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
        particles = _particles(other, model)
        columns = [
            values.reshape(values.shape[0] * values.shape[1], -1) for values in particles.values()
        ]
        return BatchedFunction.of_model(model, [model.logp()])(np.concatenate(columns, axis=1))[0]


def _particles(fitted: xr.DataTree, model: pm.Model) -> dict[str, Array]:
    """Return the particles of a class, (chain, draw, ...), by the value variables of its model."""
    group, shapes = "unconstrained_posterior", value_shapes(model)
    found = {}
    for name in (variable.name for variable in model.value_vars):
        values = read_numbers(fitted, group, name, None).transpose("chain", "draw", ...).values
        if values.shape[2:] != tuple(shapes[name]):
            raise damaged(
                fitted, f"{name!r} of {group!r} has {values.shape[2:]} entries, not {shapes[name]}"
            )
        found[name] = values.astype(float)
    return found


def _prediction(estimate: Estimate, method: str, pareto_k: float) -> Prediction:
    """Return a prediction whose whole error is its own: no other class shares its draws."""
    return Prediction(estimate, estimate.standard_error, method, pareto_k)


class ClassPredictive:
    r"""Marginal likelihood of new data ``D`` under a fitted class ``C``.

    .. math:: P(D | C) = \int P(D | θ) P(θ | C) \, dθ

    Three methods are tried in this order, and the first reliable one gives the result:

    ``"class draws"``
        The mean likelihood of the stored draws of the class.
    ``"adapted draws"``
        Importance sampling of the joint density of ``θ``, the training data and the new data. The
        first proposal is a mixture at the modes of this density, which optimisation finds from the
        modes of the class. If its draws are not accurate enough, the mixture of the class is
        adapted to the density in tempered steps. The integral is divided by the normaliser of the
        class's posterior, which is computed once, also by importance sampling. The errors of both
        are added in quadrature.
    ``"tempering"``
        SMC from the class's draws to the new data, see :class:`BatchedSMC`.

    The first two methods are reliable if the Pareto shape of the weights is below 0.5 and at least
    400 draws are effective [1]_.

    Parameters
    ----------
    fitted : xarray.DataTree
        The fitted class.
    kind : Pooled
        Settings of all classes.
    forward : ForwardModel
        Forward model of the new data. All classes may share it; its data can be replaced.
    rng : numpy.random.Generator
        Generator of the draws for the mixture and the normaliser.
    signals : collection of str, optional
        Signals of the new data that are used; all when missing.

    References
    ----------
    .. [1] A. Vehtari, D. Simpson, A. Gelman, Y. Yao and J. Gabry, Pareto smoothed importance
       sampling, Journal of Machine Learning Research 25 (2024) 72.
    """

    @without_traces
    def __init__(
        self,
        fitted: xr.DataTree,
        kind: Pooled,
        forward: ForwardModel,
        rng: np.random.Generator,
        signals: Collection[str] | None = None,
    ) -> None:
        self.signals = signals
        model = kind.model(inflation_data_of(fitted))
        sizes = {name: model[name] for name in kind.likelihood.unknowns}
        tube = forward.tube({name: model[name] for name in kind.energy.parameter_names})
        with model:
            new = pm.Potential("new", kind.likelihood.log_likelihood(tube, sizes, signals))

        particles = _particles(fitted, model)
        count, draws_of_chain = next(iter(particles.values())).shape[:2]
        self._chains = [{name: v[chain] for name, v in particles.items()} for chain in range(count)]
        self._likelihood = BatchedFunction.of_model(model, [model.logp([new])])
        self._kernel = BatchedSMC(draws=draws_of_chain, model=model, tempered=["new"])
        self._draws = np.concatenate([self._kernel.target.columns(c) for c in self._chains])

        thinned = _thinned(self._draws, _MIXTURE_DRAWS)
        components = components_for(len(thinned), self._kernel.dimension)
        self._mixture = GaussianMixture.fit(thinned, components, rng, iterations=20)
        self._width = width_of(thinned)
        self._modes = self._modes_from(self._score_of_class, self._mixture.means)
        proposal = self._mixture.heavy_tailed()
        _, log_weights = weighted_draws(self._score_of_class, proposal, _NORMALISER_DRAWS, rng)
        self._normaliser, self._normaliser_k = mean_weight(log_weights)

    def _score_of_class(self, points: Array) -> tuple[Array, Array]:
        """Return the log density without the new data, and a log likelihood of 0."""
        return self._kernel.target.score(points)[0], np.zeros(len(points))

    def _modes_from(self, score: Score, starts: Array) -> GaussianMixture | None:
        """Find modes by optimisation from starting points, in steps of the class's width."""
        modes = find_modes(gradient_by_differences(score), [starts], self._width)
        return modes and modes.mixture

    def __call__(self, random_seed: int) -> Prediction:
        """Return the marginal likelihood of the data that the forward model holds."""
        rng = np.random.default_rng(random_seed)
        return self._from_class_draws() or self._from_adapted_draws(rng) or self._by_tempering(rng)

    def _from_class_draws(self) -> Prediction | None:
        # For most specimens the class draws are not good enough: a few of them show it quickly.
        trial = self._log_likelihood(_thinned(self._draws, _TRIAL_DRAWS))
        if effective_sample_size(trial) < _FEWEST_EFFECTIVE_TRIALS:
            return None
        log_weights = self._log_likelihood(self._draws)
        estimate, pareto_k = mean_weight(log_weights)
        if not pareto_k < LARGEST_PARETO_K:
            return None
        return _prediction(estimate, "class draws", pareto_k)

    def _log_likelihood(self, points: Array) -> Array:
        """Return the log likelihood of the new data at points; NaN becomes ``-inf``."""
        return np.nan_to_num(self._likelihood(points)[0], nan=-np.inf, neginf=-np.inf)

    def _from_adapted_draws(self, rng: np.random.Generator) -> Prediction | None:
        if not self._normaliser_k < LARGEST_PARETO_K:
            return None
        found = importance_sampling(
            self._kernel.target.score,
            self._mixture,
            expectation_maximisation,
            1,
            rng,
            draws=2 * STEP_DRAWS,
            candidate=self._candidate(),
        )
        if not found.pareto_k < LARGEST_PARETO_K:
            return None
        estimate = Estimate(
            found.log_value.value - self._normaliser.value,
            float(np.hypot(found.log_value.standard_error, self._normaliser.standard_error)),
        )
        return _prediction(estimate, "adapted draws", max(found.pareto_k, self._normaliser_k))

    def _candidate(self) -> tuple[GaussianMixture, int] | None:
        """Return a proposal at the modes with the new data, and its number of draws.

        One more specimen moves the modes of a class a little. A fraction of the draws comes from
        the mixture of the class, in case there is mass elsewhere.
        """
        modes = self._modes and self._modes_from(self._kernel.target.score, self._modes.means)
        if modes is None:
            return None
        joined = modes.joined(self._mixture, _CLASS_SHARE)
        return joined.heavy_tailed(), _CANDIDATE_DRAWS

    def _by_tempering(self, rng: np.random.Generator) -> Prediction:
        values, errors = [], []
        for chain in self._chains:
            self._kernel.temper(chain, rng)
            values.append(self._kernel.log_marginal_likelihood)
            errors.append(np.sqrt(self._kernel.tempering.variance))
        return _prediction(combine_chains(np.array(values), np.array(errors)), "tempering", np.nan)


def _thinned(draws: Array, most: int) -> Array:
    """Return at most `most` of the draws, evenly spaced."""
    return draws[:: -(-len(draws) // most)]
