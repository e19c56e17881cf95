"""What every kind of class can do."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.diagnosis import log_evidence
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.keeping import Remember, compute_now
from pymc_hyperelastic.models.settings import ModelSettings

Array = NDArray[np.float64]


class Prediction(NamedTuple):
    """What a class says of new data."""

    log_evidence: Estimate
    own_error: float
    """Standard error without what the evidences of all classes have in common."""
    method: str
    pareto_k: float
    p_value: float = np.nan
    """Chance that a specimen of the class is stranger, by either of the following."""
    p_typical: float = np.nan
    p_fit: float = np.nan
    hybrids: "Callable[[int], Array] | None" = None
    """Log evidences under this class with parts of that of another number in place of its own.

    One axis a part of the kind, two entries long: this class's part, and the other's. It holds for
    the data at hand, before other ones are predicted.
    """
    probability_error: float = 0.0
    """Standard error of the class's probability from what laws it is an average of."""


class Fold(NamedTuple):
    """What classes that were fitted without some specimens say of these."""

    training_evidence: Estimate
    verdict: str
    """The worst about a class's evidence."""
    predictions: dict[str, list[Prediction]]
    """By specimen, for every class."""


Data = Mapping[str, xr.Dataset]  # by class
Fitted = Mapping[str, xr.DataTree]
Seed = np.random.SeedSequence
Predictor = Callable[[xr.Dataset, Seed], list[Prediction]]


class ClassKind(ABC):
    """How the specimens of a class are modelled.

    An instance holds the settings that all classes of one comparison share. Fitting, classifying,
    cross-validation and comparison are written against this, and know no kind by its name: a new
    one is a subclass, and a row in :mod:`pymc_hyperelastic.classes.kinds`.
    """

    #: What users call it.
    variability: ClassVar[str]
    #: Whether a prediction has a p-value.
    has_p_value: ClassVar[bool]
    #: Whether a new specimen is a fresh draw, which no specimen of the class is.
    fresh_specimens: ClassVar[bool] = False

    energy: Any
    """A strain energy, or layers."""

    @property
    def parts(self) -> tuple[str, ...]:
        """What an evidence consists of: parts of a class, or of what was measured."""
        return ("all",)

    @property
    def in_words(self) -> str:
        """What tells two kinds of one law apart that may be averaged."""
        return ""

    @classmethod
    @abstractmethod
    def of_settings(
        cls,
        energy: Any,
        likelihood: Any,
        *,
        priors: Any = None,
        geometry: Any = None,
        experiment_effect: bool = False,
        reference_stress: float | None = 20.0,
    ) -> Self:
        """Return the kind with arguments of :func:`~pymc_hyperelastic.fit_classes`.

        Arguments that the kind does not use must have their defaults.
        """

    @classmethod
    @abstractmethod
    def from_settings(cls, settings: ModelSettings) -> Self:
        """The kind of a fitted class, as it was stored."""

    def check_stored(self, fitted: xr.DataTree) -> None:
        """Raise ValueError, naming the class, unless it holds what this kind reads of one.

        Its settings are read before that, see :meth:`from_settings`.
        """

    @abstractmethod
    def settings(self) -> ModelSettings:
        """The settings as a result and a store hold them; ValueError if they cannot be stored."""

    @abstractmethod
    def check(self, data: xr.Dataset) -> None:
        """Raise TypeError or ValueError unless these data can be modelled so."""

    def check_classes(self, classes: Data) -> None:
        """Raise, naming the class, unless the data of each can be modelled so."""
        for name, data in classes.items():
            try:
                self.check(data)
            except (TypeError, ValueError) as error:
                raise type(error)(f"class {name!r}: {error}") from error

    @abstractmethod
    def fit(
        self,
        classes: Data,
        draws: int,
        chains: int,
        seed: Seed,
        progressbar: bool = False,
        remember: Remember = compute_now,
    ) -> Iterator[tuple[str, xr.DataTree | Exception]]:
        """Fit class after class, or say why one cannot be.

        All input is checked before the first is sampled. What can be kept goes through `remember`.
        """

    @abstractmethod
    def predictor(self, classes: Fitted, like: xr.Dataset, seed: Seed) -> Predictor:
        """What classes say of parts of new data, one after another, each with a seed of its own.

        All is set up for data `like` these, in ranges of radii, stretches and geometry: what is
        said of a part depends on no other one.
        """

    @abstractmethod
    def leave_out(
        self, classes: Data, seed: Seed, remember: Remember = compute_now
    ) -> Callable[[Collection[str], int, int], Fold]:
        """Fit classes, and hold them against specimens that are left out.

        What is common to all fits is done at once; then specimens, draws and chains give a fold,
        which depends on no other one.
        """

    @abstractmethod
    def new_specimens(self, fitted: xr.DataTree, rng: np.random.Generator) -> dict[str, Array]:
        """Material parameters of new specimens of a class, draws along the first axis."""

    def log_density(self, fitted: xr.DataTree, other: xr.DataTree) -> Array:
        """Log density of a class's posterior at the draws of another, its evidence left out."""
        raise ValueError(
            "the divergence is that of classes without variability, whose posteriors are "
            "distributions of the same material parameters; how far others are apart is shown by "
            "ph.plot_parameter_density"
        )


def training_evidence(fitted: Mapping[str, xr.DataTree]) -> Estimate:
    """Log evidence of the training data of all classes together."""
    values, errors = np.transpose([log_evidence(of_class) for of_class in fitted.values()])
    return Estimate(float(values.sum()), float(np.linalg.norm(errors)))
