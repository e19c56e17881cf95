"""Evidence and p-values of new specimens under classes whose specimens differ.

:class:`~pymc_hyperelastic.classes.hierarchical.HierarchicalClass` predicts new specimens with it.
"""

from collections.abc import Mapping
from functools import partial

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.classes.interface import Prediction
from pymc_hyperelastic.classes.specimen_evidence import (
    DISTRIBUTIONS,
    hybrid_evidences,
    parts_of,
    specimen_evidence,
)
from pymc_hyperelastic.classes.specimens import SpecimenSampler
from pymc_hyperelastic.classes.typicality import (
    either,
    misfit_p_value,
    noise_p_value,
    typical_p_value,
)
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.evidence.stored import read_numbers
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.models.class_distribution import distributions_of
from pymc_hyperelastic.models.population import Population
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws

Array = NDArray[np.float64]


class SpecimenPredictive:
    """Evidence and p-values of new specimens under fitted classes.

    Parameters
    ----------
    population : Population
        Settings of all classes.
    classes : dict of str to xarray.DataTree
        The fitted classes by name.
    sampler : SpecimenSampler
        Sampler of the new specimens.
    """

    def __init__(
        self, population: Population, classes: Mapping[str, xr.DataTree], sampler: SpecimenSampler
    ) -> None:
        self._population, self._sampler = population, sampler
        self._distributions = {name: distributions_of(tree) for name, tree in classes.items()}
        # The sum of squares of each specimen of a class, and its degrees of freedom.
        self._misfits = {
            name: [
                read_numbers(tree, "specimens", variable, ("specimen",), finite=False).values
                for variable in ("misfit", "freedom")
            ]
            for name, tree in classes.items()
        }

    def __call__(
        self, data: xr.Dataset, rng: np.random.Generator, draws: SpecimenDraws | None = None
    ) -> list[Prediction]:
        """Return the evidence and the p-values of a specimen under each class.

        `draws` are those of the specimen under the reference distribution, if it was sampled
        before.
        """
        draws = draws or self._sampler(data, rng)
        predictions: list[Prediction] = []
        samples = [draws]
        for number, (name, distributions) in enumerate(self._distributions.items()):
            evidence = specimen_evidence(draws, distributions)
            if evidence.pareto_k >= LARGEST_PARETO_K:
                # Sample again, with this class as the prior.
                few = distributions.at(evenly(len(distributions.location[0]), DISTRIBUTIONS))
                samples.append(self._sampler.near(data, draws, few, rng))
                again = specimen_evidence(samples[-1], distributions)
                if again.pareto_k < evidence.pareto_k:
                    # No other class shares these draws, and so none shares their error.
                    evidence = again._replace(own_error=again.log_evidence.standard_error)
            p_value, p_typical, p_fit = self._p_values(draws, name, rng)
            hybrids = partial(self._hybrids, samples, predictions, number)
            predictions.append(
                evidence._replace(
                    p_value=p_value, p_typical=p_typical, p_fit=p_fit, hybrids=hybrids
                )
            )
        return predictions

    def _hybrids(
        self, samples: list[SpecimenDraws], predictions: list[Prediction], number: int, other: int
    ) -> Array:
        """Return the log evidences of hybrids of two classes, see ``Prediction.hybrids``."""
        distributions, parts = [*self._distributions.values()], parts_of(self._population)
        evidences = predictions[number].log_evidence, predictions[other].log_evidence
        ends = evidences[0].value, evidences[1].value
        return hybrid_evidences(samples, distributions[number], distributions[other], parts, ends)

    def _p_values(
        self, draws: SpecimenDraws, name: str, rng: np.random.Generator
    ) -> tuple[float, float, float]:
        """Return three p-values of a specimen under a class: combined, of the wall, of the fit."""
        reference, distributions = self._sampler.reference, self._distributions[name]
        typical = typical_p_value(draws, self._population, reference, distributions, rng)
        fits = []
        if self._population.noises:
            fits.append(noise_p_value(draws, reference, distributions, rng))
        if self._population.known_noise:
            fits.append(misfit_p_value(draws, *self._misfits[name]))
        fit = either(*fits)
        return either(typical, fit), typical, fit
