"""Squared residuals of the best curve of a posterior."""

from typing import Any

import numpy as np
import pymc as pm
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.batched import BatchedFunction

Array = NDArray[np.float64]

# Draws of which the best curve is taken: it is within about a unit of the largest likelihood.
_LOOKED_AT = 200


class Residuals:
    """Squared residuals of the best of some particles of a model of curves, compiled once.

    Parameters
    ----------
    model : pymc.Model
    study : Study or None
        What the model was made from; without one there are no residuals.
    """

    def __init__(self, model: pm.Model, study: Any) -> None:
        self._study = study
        residuals = study.residuals(model) if study else {}
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
