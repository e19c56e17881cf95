"""Marginal likelihood of new data under a fitted class, without fitting the class again."""

from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.importance import (
    LARGEST_PARETO_K,
    adapted_mixture,
    draw_heavy_tailed,
    mean_weight,
)
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.mixture import GaussianMixture, components_for
from pymc_hyperelastic.evidence.smc import Estimate, combine_chains
from pymc_hyperelastic.models.inflation import inflation_model
from pymc_hyperelastic.models.likelihood import log_likelihood, shared_inputs
from pymc_hyperelastic.models.results import inflation_data_of
from pymc_hyperelastic.models.rules import Rule

__all__ = ["ClassPredictive", "Predictive"]

Array = NDArray[np.float64]

# Draws of the final estimate, and of a class's own evidence.
_FINAL_DRAWS, _CLASS_DRAWS = 4000, 20000


class Predictive(NamedTuple):
    """Log marginal likelihood of new data, and how it was found.

    The Pareto shape of the importance weights is NaN where there are none.
    """

    log_evidence: Estimate
    method: str
    pareto_k: float


class ClassPredictive:
    r"""Marginal likelihood of new data ``D`` under a fitted class ``C``.

    .. math:: P(D | C) = \int P(D | θ) P(θ | C) \, dθ

    The cheapest of three ways is taken that can be trusted:

    ``"class draws"``
        The mean likelihood of the stored draws of the class.
    ``"adapted draws"``
        Importance sampling from a mixture that starts at the class and follows the tempered
        likelihood of the new data. The normaliser of the class's posterior is integrated in the
        same manner, once: both errors are small, and are added.
    ``"tempering"``
        SMC from the class's draws to the new data, see :class:`BatchedSMC`.

    The first two are trusted if the Pareto shape of the weights is below 0.5 and at least 1000
    draws are effective. Everything is compiled once, and for all classes of one law together.

    Parameters
    ----------
    fitted : xarray.DataTree
        A class of :func:`pymc_hyperelastic.fit_classes`.
    settings : dict
        Its model's settings.
    rule : Rule
        How the walls of the new data are integrated.
    inputs : dict of str to array
        Some new data, as ``likelihood_inputs`` gives them; later ones replace them.
    rng : numpy.random.Generator
        For the class's own integral.

    References
    ----------
    A. Vehtari, D. Simpson, A. Gelman, Y. Yao and J. Gabry, Pareto smoothed importance sampling,
    Journal of Machine Learning Research 25 (2024) 72.
    """

    def __init__(
        self,
        fitted: xr.DataTree,
        settings: dict[str, Any],
        rule: Rule,
        inputs: dict[str, Array],
        rng: np.random.Generator,
    ) -> None:
        self._inputs = shared_inputs("new", inputs)
        model = inflation_model(data=inflation_data_of(fitted), **settings)
        energy = settings["energy"]
        noise = {
            name: model[name] if name in model.named_vars else value
            for name, value in settings.items()
            if name not in ("energy", "priors")
        }
        parameters = {name: model[name] for name in energy.parameter_names}
        with model:
            likelihood = log_likelihood(energy, self._inputs, rule, parameters, **noise)
            new = pm.Potential("new", likelihood)

        particles = fitted["unconstrained_posterior"].to_dataset()
        self._chains = [
            {name: particles[name].values[chain] for name in particles.data_vars}
            for chain in range(particles.sizes["chain"])
        ]
        columns = [particles[v.name].values for v in model.value_vars]
        shape = particles.sizes["chain"] * particles.sizes["draw"], -1
        self._draws = np.concatenate([np.reshape(x, shape) for x in columns], axis=1)
        self._likelihood = BatchedFunction.of_model(model, [model.logp([new])])
        self._kernel = BatchedSMC(draws=particles.sizes["draw"], model=model, tempered=["new"])

        some = self._draws[:: max(1, len(self._draws) // _FINAL_DRAWS)]
        components = components_for(len(some), self._kernel.dimension)
        self._mixture = GaussianMixture.fit(some, components, rng, iterations=20)
        points, log_density = draw_heavy_tailed(self._mixture, _CLASS_DRAWS, rng)
        self._normaliser, self._normaliser_k = mean_weight(
            self._kernel.score(points)[0] - log_density
        )

    def __call__(self, inputs: dict[str, Array], random_seed: int) -> Predictive:
        """Marginal likelihood of the data with these inputs."""
        for name, value in inputs.items():
            self._inputs[name].set_value(value, borrow=True)
        rng = np.random.default_rng(random_seed)
        return self._from_class_draws() or self._from_adapted_draws(rng) or self._by_tempering(rng)

    def _from_class_draws(self) -> Predictive | None:
        log_weights = np.nan_to_num(self._likelihood(self._draws)[0], nan=-np.inf, neginf=-np.inf)
        estimate, pareto_k = mean_weight(log_weights)
        if pareto_k >= LARGEST_PARETO_K:
            return None
        return Predictive(estimate, "class draws", pareto_k)

    def _from_adapted_draws(self, rng: np.random.Generator) -> Predictive | None:
        if self._normaliser_k >= LARGEST_PARETO_K:
            return None
        mixture = adapted_mixture(self._kernel.score, self._mixture, rng)
        if mixture is None:
            return None
        points, log_density = draw_heavy_tailed(mixture, _FINAL_DRAWS, rng)
        log_weights = sum(self._kernel.score(points)) - log_density
        integral, pareto_k = mean_weight(log_weights)
        if pareto_k >= LARGEST_PARETO_K:
            return None
        estimate = Estimate(
            integral.value - self._normaliser.value,
            float(np.hypot(integral.standard_error, self._normaliser.standard_error)),
        )
        return Predictive(estimate, "adapted draws", max(pareto_k, self._normaliser_k))

    def _by_tempering(self, rng: np.random.Generator) -> Predictive:
        values, errors = [], []
        for chain in self._chains:
            self._kernel.temper(chain, rng)
            values.append(self._kernel.log_marginal_likelihood)
            errors.append(np.sqrt(self._kernel.log_evidence_variance))
        return Predictive(combine_chains(np.array(values), np.array(errors)), "tempering", np.nan)
