"""Interface of the kinds of classes, and the types of their results.

Fitting, classification, cross-validation and comparison use the interface; ``pooled`` and
``hierarchical`` implement it.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.diagnosis import log_evidence, worst_verdict
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.keeping import Remember, compute_now
from pymc_hyperelastic.models.settings import ModelSettings

Array = NDArray[np.float64]

# Number of draws of an estimate that takes no time: the relative error of a standard deviation from
# 4000 draws is 1 %.
DRAWS = 4000
# Fewest draws that represent a distribution: fewer are refused, or give no estimate.
FEWEST_DRAWS = 100
# Probability below which a class or a strain energy changes no decision and no reported digit.
NEGLIGIBLE = 1e-4


class Prediction(NamedTuple):
    """Prediction of new data by one class."""

    log_evidence: Estimate
    """Log marginal likelihood of the new data under the class, in nats."""
    own_error: float
    """Standard error of the log evidence without the part that all classes share, in nats."""
    method: str
    """Method by which the evidence was computed."""
    pareto_k: float
    """Pareto shape of its importance weights; NaN after tempering."""
    p_value: float = np.nan
    """P-value of the hypothesis that the specimen belongs to the class: the next two combined."""
    p_typical: float = np.nan
    """P-value of the specimen's wall, see ``typical_p_value``."""
    p_fit: float = np.nan
    """P-value of its noise or misfit, see ``noise_p_value`` and ``misfit_p_value``."""
    hybrids: "Callable[[int], Array] | None" = None
    """Function of the number of another class: log evidences under hybrids of the two classes.

    The result has one axis for each of the kind's ``parts``, with the entries 0 (the part is that
    of this class) and 1 (that of the other class). Call it before the predictor is called for other
    data.
    """
    probability_error: float = 0.0
    """Standard error of the class's probability that comes from averaging over several laws."""


class Fold(NamedTuple):
    """Predictions of specimens by classes that were fitted without them."""

    training_evidence: Estimate
    """Log evidence of the training data of all classes."""
    verdict: str
    """Worst verdict on the evidence of a class."""
    predictions: dict[str, list[Prediction]]
    """Predictions of each specimen by its name, one for each class."""

    @classmethod
    def of(cls, fitted: Mapping[str, xr.DataTree], predictions: dict[str, Any]) -> "Fold":
        """Return the predictions by fitted classes, with their evidence and its verdict."""
        return cls(training_evidence(fitted), worst_verdict(fitted.values()), predictions)


# Data by the name of the group, and fitted results by the name of the class, which is the same.
Groups = Mapping[str, xr.Dataset]
Fitted = Mapping[str, xr.DataTree]
Seed = np.random.SeedSequence
Predictor = Callable[[xr.Dataset, Seed], list[Prediction]]


class ClassKind(ABC):
    """A way to model the specimens of a class, with the settings that all classes share.

    Fitting, classification, cross-validation and comparison depend only on this interface. A new
    kind is a subclass and an entry in :mod:`pymc_hyperelastic.classes.kinds`.
    """

    #: Name of this kind in stored settings, see ``ModelSettings.variability``.
    stored_as: ClassVar[str]
    #: True if a prediction has a p-value.
    has_p_value: ClassVar[bool]
    #: True if a new specimen is modelled as a new draw from the class distribution.
    fresh_specimens: ClassVar[bool] = False

    energy: Any
    """A strain energy, or layers."""

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts into which an evidence is divided: parts of the class, or signals."""
        return ("all",)

    @property
    def in_words(self) -> str:
        """Words for labels that distinguish kinds with the same law in an average over laws."""
        return ""

    @classmethod
    @abstractmethod
    def from_settings(cls, settings: ModelSettings) -> Self:
        """Return the kind of a fitted class from its stored settings."""

    def check_stored(self, fitted: xr.DataTree) -> None:
        """Raise ValueError, naming the class, if values that this kind needs are missing or wrong.

        The settings are read and checked before, see :meth:`from_settings`.
        """

    @abstractmethod
    def settings(self) -> ModelSettings:
        """Return the settings in the form in which results and stores hold them.

        Raises
        ------
        ValueError
            If a setting cannot be stored.
        """

    @abstractmethod
    def check(self, data: xr.Dataset) -> None:
        """Raise TypeError or ValueError unless this kind can model these data."""

    def check_groups(self, groups: Groups) -> None:
        """Raise, naming the group, unless this kind can model the data of each group."""
        by_group(groups, self.check)

    @abstractmethod
    def fit(
        self,
        groups: Groups,
        draws: int,
        chains: int,
        seed: Seed,
        progressbar: bool = False,
        remember: Remember = compute_now,
    ) -> Iterator[tuple[str, xr.DataTree | Exception]]:
        """Fit one class after the other; yield its name with its result, or with an error.

        All input is checked before the first class is sampled. Computations that may be stored are
        done by `remember`.
        """

    @abstractmethod
    def predictor(self, classes: Fitted, like: xr.Dataset, seed: Seed) -> Predictor:
        """Return a function that predicts one part of the new data under each class.

        The function takes the data of the part and a seed. Models and integrators are set up here,
        for the ranges of radii, stretches and geometry in `like`, which is all the new data: the
        prediction of a part then does not depend on other parts.
        """

    @abstractmethod
    def leave_out(
        self, groups: Groups, seed: Seed, remember: Remember = compute_now
    ) -> Callable[[Collection[str], int], Fold]:
        """Return a function that fits the classes without some specimens, and predicts these.

        The function takes the names of the specimens and the number of draws. Computations that
        all folds share are done here. A fold does not depend on other folds.
        """

    @abstractmethod
    def new_specimens(self, fitted: xr.DataTree, rng: np.random.Generator) -> dict[str, Array]:
        """Draw new specimens of a class; return material parameters, draws along the first axis."""

    def log_density(self, fitted: xr.DataTree, other: xr.DataTree) -> Array:
        """Return the unnormalised log posterior density of a class at the draws of another one."""
        raise ValueError(
            "the divergence is defined only for classes without variability, whose posteriors are "
            "distributions of the same material parameters. Use ph.plot_parameter_density to "
            "compare classes with variability"
        )


def by_group[Result](groups: Groups, function: Callable[[xr.Dataset], Result]) -> dict[str, Result]:
    """Return what a function of the data returns, by group; its errors name the group."""
    results = {}
    for name, data in groups.items():
        try:
            results[name] = function(data)
        except (TypeError, ValueError) as error:
            raise type(error)(f"group {name!r}: {error}") from error
    return results


def training_evidence(fitted: Mapping[str, xr.DataTree]) -> Estimate:
    """Return the log evidence of the training data of all classes, the sum over classes."""
    values, errors = np.transpose([log_evidence(tree) for tree in fitted.values()])
    return Estimate(float(values.sum()), float(np.linalg.norm(errors)))
