"""Classes whose specimens differ: each has parameters of its own, drawn from a distribution."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pymc.progress_bar import create_simple_progress

from pymc_hyperelastic.classes.distribution import (
    ClassModel,
    draws_of_class,
    fit_distribution,
)
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
from pymc_hyperelastic.classes.specimen_evidence import (
    PARTS,
    hybrid_evidences,
    near_class,
    specimen_evidence,
)
from pymc_hyperelastic.classes.specimens import (
    SpecimenSampler,
    fresh_specimens,
    reference_of,
)
from pymc_hyperelastic.classes.typicality import (
    either,
    misfit_p_value,
    noise_p_value,
    typical_p_value,
)
from pymc_hyperelastic.data.select import specimens_apart, specimens_of, tests_at
from pymc_hyperelastic.evidence.checks import check_count, no_progress
from pymc_hyperelastic.evidence.diagnosis import worst_verdict
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.evidence.keeping import Remember, compute_now, named
from pymc_hyperelastic.evidence.smc import seed_of
from pymc_hyperelastic.evidence.stored import read_numbers, reading
from pymc_hyperelastic.evidence.stored_evidence import check_evidence
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.checks import LARGEST_CURVE_ERROR
from pymc_hyperelastic.models.class_distribution import (
    SPREAD_OF_NOISE,
    ClassDistribution,
    check_class,
    distributions_of,
)
from pymc_hyperelastic.models.forward import ForwardModel
from pymc_hyperelastic.models.geometry import check_geometry
from pymc_hyperelastic.models.likelihoods import Likelihood, as_likelihood
from pymc_hyperelastic.models.population import Population
from pymc_hyperelastic.models.settings import (
    ModelSettings,
    holds_inflation_data,
    inflation_data_of,
)
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws
from pymc_hyperelastic.models.study import Study

Array = NDArray[np.float64]

# Fraction of the materials of the prior whose curves may be inaccurate, as those of fibres that
# slacken within a wall: the curves of each specimen are refined for its own material.
_INACCURATE = 0.25
# Materials of each class whose curves are compared with quadrature.
_MATERIALS = 64
# Tests in which they are compared.
_TESTS = 12
# A misfit whose size is known exactly.
_AS_NOISE = xr.DataArray([1e9])


@dataclass(frozen=True)
class Variability(Population, ClassKind):
    """Settings of classes whose specimens differ."""

    variability: ClassVar[str] = "specimen"
    has_p_value: ClassVar[bool] = True
    fresh_specimens: ClassVar[bool] = True

    @classmethod
    def of_settings(
        cls,
        energy: StrainEnergy | Sequence[Layer],
        likelihood: Likelihood | Any,
        *,
        priors: Mapping[str, Any] | None = None,
        geometry: Mapping[str, Any] | None = None,
        experiment_effect: bool = False,
        reference_stress: float | None = 20.0,
    ) -> "Variability":
        """The kind, of settings of :func:`~pymc_hyperelastic.population_model`."""
        observed = as_likelihood(likelihood).as_observed()
        settings = experiment_effect, reference_stress, priors, check_geometry(geometry)
        return cls(energy, observed, *settings)

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts of a class's distribution that are there."""
        there = {"experiments": bool(self.experiment_effect), "noise": bool(self.noises)}
        return tuple(part for part in PARTS if there.get(part, True))

    @property
    def in_words(self) -> str:
        """Whether experiments on a specimen differ."""
        return "with experiment effect" if self.experiment_effect else ""

    @cached_property
    def reference(self) -> ClassDistribution:
        """Distribution under which each specimen is sampled."""
        return reference_of(self)

    def sampler(self, data: xr.Dataset) -> SpecimenSampler:
        """Sampler of the specimens of these data, each by itself."""
        return SpecimenSampler(self, self._curves_of_specimens(data), self.reference)

    def _curves_of_specimens(self, data: xr.Dataset) -> ForwardModel:
        """Forward model of specimens, each by itself."""
        # Without an effect all tests of a specimen share its parameters, and matrices.
        own, accuracy = bool(self.experiment_effect), {"tolerance": LARGEST_CURVE_ERROR}
        return self.forward_model(data, by_test=own, **accuracy, inaccurate=_INACCURATE)

    def settings(self) -> ModelSettings:
        """The settings as a result holds them; ValueError if a prior cannot be stored."""
        return ModelSettings.of(
            self.energy,
            self.priors or {},
            self.likelihood,
            self.geometry,
            variability=self.variability,
            experiment_effect=bool(self.experiment_effect),
            reference_stress=self.reference_stress,
        )

    @classmethod
    def from_settings(cls, settings: ModelSettings) -> "Variability":
        """Settings of a fitted class."""
        likelihood = settings.make_likelihood()
        if likelihood is None:
            raise ValueError("its likelihood is missing")
        return cls(
            settings.make_wall(),
            likelihood,
            settings.experiment_effect,
            settings.reference_stress,
            settings.make_priors(),
            settings.make_geometry(),
        )

    def check_stored(self, fitted: xr.DataTree) -> None:
        """Raise unless a class has draws of its distribution, and sound data if it has any."""
        with reading(fitted):
            if holds_inflation_data(fitted):
                self.check(inflation_data_of(fitted))
            names = self.scale.names
        check_evidence(fitted)
        needed = ["location", "spread", *(SPREAD_OF_NOISE[noise] for noise in self.noises)]
        if self.experiment_effect:
            needed += ["experiment_spread", "effect_spread"]
        check_class(fitted, names, needed)

    def fit(
        self,
        classes: Data,
        draws: int,
        chains: int,
        seed: Seed,
        progressbar: bool = False,
        remember: Remember = compute_now,
    ) -> Iterator[tuple[str, xr.DataTree | Exception]]:
        """Fit the distribution of class after class, of specimens that are sampled once."""
        check_count("draws", draws, 100)
        check_count("chains", chains, 1)
        self.check_classes(classes)
        self.settings()
        return self._fitted(classes, draws, chains, seed, progressbar, remember)

    def _fitted(
        self,
        classes: Data,
        draws: int,
        chains: int,
        seed: Seed,
        progressbar: bool,
        remember: Remember,
    ) -> Iterator[tuple[str, xr.DataTree | Exception]]:
        progress, model = create_simple_progress(progressbar), ClassModel(self)
        # Of each class its specimens, a first fit, and the chains.
        steps = sum(len(specimens_of(data)[0]) + 1 + chains for data in classes.values())
        with progress:
            bar = progress.add_task("Fitting classes", completed=0, total=steps)
            advance = partial(progress.advance, bar)
            seeds = seed.spawn(len(classes))
            for i, ((name, data), own) in enumerate(zip(classes.items(), seeds, strict=True)):
                rng, sampler = np.random.default_rng(own), self.sampler(data)
                of_class = named(f"class-{i}", remember)
                try:
                    specimens = sample_specimens(sampler, data, own, advance, of_class)
                    close = draws_of_class(model, sampler, data, specimens, rng)
                    advance()
                    fitted = fit_distribution(model, close, draws, chains, own, advance)
                except (ValueError, ArithmeticError) as error:
                    yield name, error
                    continue
                fitted.attrs |= self.settings().attrs()
                for group, dataset in Study(self.energy, data, {}).groups().items():
                    fitted[group] = dataset
                yield name, fitted

    def predictor(self, classes: Fitted, like: xr.Dataset, seed: Seed) -> Predictor:
        """What classes say of new specimens, each of which is sampled by itself."""
        self.check(like)
        forward = self._accurate_for_classes(classes, like, seed)
        sampler = SpecimenSampler(self, forward, self.reference)
        predictive = SpecimenPredictive(self, classes, sampler)
        return lambda data, seed: predictive(data, np.random.default_rng(seed))

    def _accurate_for_classes(self, classes: Fitted, like: xr.Dataset, seed: Seed) -> ForwardModel:
        """Curves that are accurate for new specimens of the classes, too."""
        rng, forward = np.random.default_rng(seed), self._curves_of_specimens(like)
        specimens = [self.new_specimens(fitted, rng) for fitted in classes.values()]
        materials = {
            name: np.concatenate([of_class[name][:_MATERIALS] for of_class in specimens])
            for name in specimens[0]
        }
        some = tests_at(like, evenly(like.sizes["test"], _TESTS))
        if forward.errors(some, materials).max() <= LARGEST_CURVE_ERROR:
            return forward
        return forward.refined(some, materials)

    def leave_out(
        self, classes: Data, seed: Seed, remember: Remember = compute_now
    ) -> Callable[[Collection[str], int, int], Fold]:
        """Sample all specimens once; without some of them only the distributions are fitted."""
        rng, model = np.random.default_rng(seed), ClassModel(self)
        samplers = {name: self.sampler(data) for name, data in classes.items()}
        specimens = {
            name: sample_specimens(
                samplers[name], data, seed, remember=named(f"class-{i}", remember)
            )
            for i, (name, data) in enumerate(classes.items())
        }
        close = {
            name: draws_of_class(model, samplers[name], data, specimens[name], rng)
            for name, data in classes.items()
        }

        def fold(left_out: Collection[str], draws: int, chains: int) -> Fold:
            fitted, of_fold = {}, seed_of(seed, ", ".join(left_out))
            for name, of_class in close.items():
                stay = {s: d for s, d in of_class.specimens.items() if s not in left_out}
                some = of_class._replace(specimens=stay)
                (own,) = of_fold.spawn(1)
                fitted[name] = fit_distribution(model, some, draws, chains, own)
            rng = np.random.default_rng(*of_fold.spawn(1))
            predictions = {}
            for name, data in classes.items():
                predictive = SpecimenPredictive(self, fitted, samplers[name])
                for specimen, part in specimens_apart(data, left_out).items():
                    predictions[specimen] = predictive(part, rng, specimens[name][specimen])
            return Fold(training_evidence(fitted), worst_verdict(fitted.values()), predictions)

        return fold

    def new_specimens(self, fitted: xr.DataTree, rng: np.random.Generator) -> dict[str, Array]:
        """Parameters of fresh draws from the class's distribution."""
        return self._materials(distributions_of(fitted), rng)

    def _materials(
        self, distributions: ClassDistribution, rng: np.random.Generator
    ) -> dict[str, Array]:
        """Parameters of one new specimen of each distribution."""
        draws = fresh_specimens(self, distributions, 1, rng)
        return self.scale.numbers([draws[name][:, 0] for name in self.scale.names])


def sample_specimens(
    sampler: SpecimenSampler,
    data: xr.Dataset,
    seed: Seed,
    advance: Callable[[], None] = no_progress,
    remember: Remember = compute_now,
) -> dict[str, SpecimenDraws]:
    """Draws of each specimen of the data; `advance` is called after each.

    They depend on nothing but its own curves, and are kept by `remember`.

    Raises
    ------
    ValueError
        If one cannot be sampled; it is named.
    """
    draws = {}
    for i, (name, part) in enumerate(specimens_apart(data).items()):

        def sample(name: str = name, part: xr.Dataset = part) -> xr.Dataset:
            return sampler(part, np.random.default_rng(seed_of(seed, name))).as_dataset()

        try:
            draws[name] = SpecimenDraws.from_dataset(remember(f"specimen-{i}", sample))
            advance()
        except (ValueError, ArithmeticError) as error:
            raise ValueError(f"specimen {name!r} cannot be sampled: {error}") from error
    return draws


def _misfits_of(fitted: xr.DataTree) -> tuple[Array, Array]:
    """Squared misfit of the specimens of a class, and its freedom."""
    stored = fitted.children.get("specimens", {})
    misfit, freedom = (
        read_numbers(fitted, "specimens", name, ("specimen",), finite=False)
        if name in stored
        else _AS_NOISE
        for name in ("misfit", "freedom")
    )
    return misfit.values, freedom.values


class SpecimenPredictive:
    """What fitted classes say of new specimens.

    Parameters
    ----------
    settings : Variability
        Settings of all classes.
    classes : dict of str to xarray.DataTree
        The classes by name.
    sampler : SpecimenSampler
        Sampler of the new specimens.
    """

    def __init__(
        self, settings: Variability, classes: Mapping[str, xr.DataTree], sampler: SpecimenSampler
    ) -> None:
        self._settings, self._sampler = settings, sampler
        self._distributions = {name: distributions_of(tree) for name, tree in classes.items()}
        # Older files do not tell how well the class's own specimens are fitted: as noise has it.
        self._misfits = {name: _misfits_of(tree) for name, tree in classes.items()}
        self._closer: dict[str, SpecimenSampler] = {}

    def __call__(
        self, data: xr.Dataset, rng: np.random.Generator, draws: SpecimenDraws | None = None
    ) -> list[Prediction]:
        """Evidence and predictive p-value of the specimen of these data under each class."""
        draws = draws or self._sampler(data, rng)
        predictions: list[Prediction] = []
        samples = [draws]
        for number, (name, distributions) in enumerate(self._distributions.items()):
            evidence = specimen_evidence(draws, distributions)
            if evidence.pareto_k >= LARGEST_PARETO_K:
                # Sampled closer to the class.
                samples.append(self._near(name)(data, rng))
                again = specimen_evidence(samples[-1], distributions)
                if again.pareto_k < evidence.pareto_k:
                    # From draws of its own, which no other class shares.
                    evidence = again._replace(own_error=again.log_evidence.standard_error)
            predictions.append(
                Prediction(
                    evidence.log_evidence,
                    evidence.own_error,
                    evidence.method,
                    evidence.pareto_k,
                    *self._p_values(draws, name, rng),
                    partial(self._hybrids, samples, predictions, number),
                )
            )
        return predictions

    def _hybrids(
        self, samples: list[SpecimenDraws], known: list[Prediction], number: int, other: int
    ) -> Array:
        """Log evidences under one class with parts of another, see :class:`Prediction`."""
        distributions, parts = [*self._distributions.values()], self._settings.parts
        own, others = distributions[number], distributions[other]
        ends = known[number].log_evidence.value, known[other].log_evidence.value
        return hybrid_evidences(samples, own, others, parts, ends)

    def _near(self, name: str) -> SpecimenSampler:
        """Sampler under a distribution like that of a class."""
        if name not in self._closer:
            near = near_class(self._distributions[name])
            self._closer[name] = SpecimenSampler(self._settings, self._sampler.forward, near)
        return self._closer[name]

    def _p_values(
        self, draws: SpecimenDraws, name: str, rng: np.random.Generator
    ) -> tuple[float, float, float]:
        """Whether the specimen could be of a class: by its wall or its noise, and by each."""
        reference, distributions = self._sampler.reference, self._distributions[name]
        typical = typical_p_value(draws, self._settings, reference, distributions, rng)
        fits = []
        if self._settings.noises:
            fits.append(noise_p_value(draws, reference, distributions, rng))
        if self._settings.known_noise:
            fits.append(misfit_p_value(draws, *self._misfits[name]))
        fit = either(*fits)
        return either(typical, fit), typical, fit
