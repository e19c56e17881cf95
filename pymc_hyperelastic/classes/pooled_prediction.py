"""Marginal likelihood of new data under a class whose specimens share one set of parameters.

The evidence can be divided between the measured signals: pressure, slope and force.
:class:`~pymc_hyperelastic.classes.pooled.PooledClass` predicts new specimens with it.
"""

from collections.abc import Callable, Collection, Sequence
from functools import cache, partial

import numpy as np
import pymc as pm
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.classes.interface import DRAWS, FEWEST_DRAWS, Prediction
from pymc_hyperelastic.evidence.batched import BatchedFunction, value_shapes, without_traces
from pymc_hyperelastic.evidence.estimate import Estimate, combine_chains
from pymc_hyperelastic.evidence.importance import (
    ENOUGH,
    LARGEST_PARETO_K,
    importance_sampling,
    mean_weight,
)
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.mixture import GaussianMixture, components_for
from pymc_hyperelastic.evidence.modes import find_modes
from pymc_hyperelastic.evidence.proposal import expectation_maximisation
from pymc_hyperelastic.evidence.stored import damaged, read_numbers
from pymc_hyperelastic.evidence.target import Score, gradient_by_differences, width_of
from pymc_hyperelastic.evidence.weights import effective_sample_size
from pymc_hyperelastic.mechanics.interpolation import evenly

Array = NDArray[np.float64]

# Function of the number of a class and of a set of signals: the log evidence, in nats, of these
# signals alone under the class; NaN if it is unknown.
EvidenceOf = Callable[[int, frozenset[str]], float]


def particles_of(fitted: xr.DataTree, model: pm.Model) -> dict[str, Array]:
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
    model : pymc.Model
        Model of the class with its training data.
    new : TensorVariable
        Log likelihood of the new data, of the unknowns of this model. The new data are shared
        variables, which can be replaced.
    rng : numpy.random.Generator
        Generator of the draws for the mixture and the normaliser.

    References
    ----------
    .. [1] A. Vehtari, D. Simpson, A. Gelman, Y. Yao and J. Gabry, Pareto smoothed importance
       sampling, Journal of Machine Learning Research 25 (2024) 72.
    """

    @without_traces
    def __init__(
        self,
        fitted: xr.DataTree,
        model: pm.Model,
        new: TensorVariable,
        rng: np.random.Generator,
    ) -> None:
        with model:
            new = pm.Potential("new", new)
        particles = particles_of(fitted, model)
        count, draws_of_chain = next(iter(particles.values())).shape[:2]
        self._chains = [{name: v[chain] for name, v in particles.items()} for chain in range(count)]
        self._likelihood = BatchedFunction.of_model(model, [model.logp([new])])
        self._kernel = BatchedSMC(draws=draws_of_chain, model=model, tempered=["new"])
        self._draws = np.concatenate([self._kernel.target.columns(c) for c in self._chains])

        thinned = self._draws[evenly(len(self._draws), DRAWS)]
        components = components_for(len(thinned), self._kernel.dimension)
        self._mixture = GaussianMixture.fit(thinned, components, rng, iterations=20)
        self._width = width_of(thinned)
        self._modes = self._modes_from(self._score_of_class, self._mixture.means)
        self._normaliser = importance_sampling(
            self._score_of_class,
            self._mixture,
            expectation_maximisation,
            1,
            rng,
            draws=5 * DRAWS,  # its error enters the evidences of all new data
        )

    def _score_of_class(self, points: Array) -> tuple[Array, Array]:
        """Return the log density without the new data, and a log likelihood of 0."""
        return self._kernel.target.score(points)[0], np.zeros(len(points))

    def _modes_from(self, score: Score, starts: Array) -> GaussianMixture | None:
        """Find modes by optimisation from starting points, in steps of the class's width."""
        modes = find_modes(gradient_by_differences(score), [starts], self._width)
        return modes and modes.mixture

    def __call__(self, random_seed: int) -> Prediction:
        """Return the marginal likelihood of the new data."""
        rng = np.random.default_rng(random_seed)
        return self._from_class_draws() or self._from_adapted_draws(rng) or self._by_tempering(rng)

    def _from_class_draws(self) -> Prediction | None:
        # For most specimens too few class draws are effective: some of them show it quickly.
        trial = self._log_likelihood(self._draws[evenly(len(self._draws), FEWEST_DRAWS)])
        if effective_sample_size(trial) / len(trial) < ENOUGH / len(self._draws):
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
        if not self._normaliser.pareto_k < LARGEST_PARETO_K:
            return None
        found = importance_sampling(
            self._kernel.target.score,
            self._mixture,
            expectation_maximisation,
            1,
            rng,
            candidate=self._candidate(),
        )
        if not found.pareto_k < LARGEST_PARETO_K:
            return None
        (value, error), (of_class, error_of_class) = found.log_value, self._normaliser.log_value
        estimate = Estimate(value - of_class, float(np.hypot(error, error_of_class)))
        pareto_k = max(found.pareto_k, self._normaliser.pareto_k)
        return _prediction(estimate, "adapted draws", pareto_k)

    def _candidate(self) -> tuple[GaussianMixture, int] | None:
        """Return a proposal at the modes with the new data, and its number of draws.

        One more specimen moves the modes of a class a little. Half of the draws come from the
        mixture of the class, in case there is mass elsewhere.
        """
        modes = self._modes and self._modes_from(self._kernel.target.score, self._modes.means)
        if modes is None:
            return None
        return modes.joined(self._mixture).heavy_tailed(), DRAWS

    def _by_tempering(self, rng: np.random.Generator) -> Prediction:
        values, errors = [], []
        for chain in self._chains:
            self._kernel.temper(chain, rng)
            values.append(self._kernel.log_marginal_likelihood)
            errors.append(np.sqrt(self._kernel.tempering.variance))
        return _prediction(combine_chains(np.array(values), np.array(errors)), "tempering", np.nan)


def with_hybrids(
    predictions: Sequence[Prediction],
    signals: Sequence[str],
    measured: Collection[str],
    evidence_of: EvidenceOf,
) -> list[Prediction]:
    r"""Return the predictions with a function for evidences of hybrids of two classes.

    A hybrid takes the signals in a set ``S`` from the other class, and those in its complement
    ``S'`` from the class itself:

    .. math:: v(S) = \ln P(D_{S'} | C) + \ln P(D_S | C_{\mathrm{other}})

    `signals` that were not `measured` do not contribute. The evidence of some of the signals is
    computed when it is first needed, and then cached. See ``Prediction.hybrids``.
    """
    evidence_of, all_measured = cache(evidence_of), frozenset(measured)

    def log_evidence(number: int, chosen: frozenset[str]) -> float:
        if chosen >= all_measured:
            value, error = predictions[number].log_evidence
            return value if np.isfinite(error) else np.nan
        chosen &= all_measured
        return evidence_of(number, chosen) if chosen else 0.0

    def hybrids(own: int, other: int) -> Array:
        values = np.empty((2,) * len(signals))
        for place in np.ndindex(values.shape):
            from_other = frozenset(s for s, moved in zip(signals, place, strict=True) if moved)
            of_own = log_evidence(own, all_measured - from_other)
            values[place] = of_own + log_evidence(other, from_other)
        return values

    return [p._replace(hybrids=partial(hybrids, i)) for i, p in enumerate(predictions)]
