"""How far the best curve of a posterior is from what was measured."""

import numpy as np
import pymc as pm
import xarray as xr

from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.results import study_of

# Draws of which the best curve is taken: it is within about a unit of the largest likelihood.
_LOOKED_AT = 200


class Residuals:
    """Squared residuals of the best of some particles of a model of curves, compiled once."""

    def __init__(self, model: pm.Model) -> None:
        self._study = study_of(model)
        residuals = self._study.residuals(model) if self._study else {}
        terms = model.replace_rvs_by_values([*residuals.values()])
        self._signals = [*residuals]
        self._values = BatchedFunction.of_model(model, terms) if terms else None

    def of(self, data: xr.Dataset, particles: Array) -> xr.Dataset:
        """``chi_square`` and ``points`` by test and signal; nothing where a model has no residuals.

        Parameters
        ----------
        data : xarray.Dataset
            The data that the model holds now.
        particles : array, shape (n, d)
            Draws of the posterior.
        """
        if self._values is None or self._study is None:
            return xr.Dataset()
        values = self._values(particles[:: -(-len(particles) // _LOOKED_AT)])
        residuals = dict(zip(self._signals, map(np.asarray, values), strict=True))
        return self._study.chi_squares(data, residuals)
