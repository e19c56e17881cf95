"""Classes with variability: the parameters of each specimen are drawn from a class distribution.

:class:`HierarchicalClass` fits such classes and predicts new specimens. Fitting, classification,
cross-validation and comparison of classes call it through the interface ``ClassKind``.
"""

from collections.abc import Callable, Collection, Iterator
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from typing import ClassVar

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pymc.progress_bar import create_simple_progress

from pymc_hyperelastic.classes.distribution import ClassModel, draws_of_class, fit_distribution
from pymc_hyperelastic.classes.hierarchical_prediction import SpecimenPredictive
from pymc_hyperelastic.classes.interface import (
    FEWEST_DRAWS,
    ClassKind,
    Fitted,
    Fold,
    Groups,
    Predictor,
    Seed,
)
from pymc_hyperelastic.classes.reference import fresh_specimens, reference_of
from pymc_hyperelastic.classes.specimen_evidence import parts_of
from pymc_hyperelastic.classes.specimens import SpecimenSampler
from pymc_hyperelastic.data.select import specimens_apart, specimens_of
from pymc_hyperelastic.evidence.checks import check_count, no_progress
from pymc_hyperelastic.evidence.keeping import Remember, compute_now, named
from pymc_hyperelastic.evidence.smc import seed_of
from pymc_hyperelastic.evidence.stored import reading
from pymc_hyperelastic.evidence.stored_evidence import check_evidence
from pymc_hyperelastic.evidence.verdicts import BAD, GOOD, Check, ModelChecks, registered_checks
from pymc_hyperelastic.models.checks import LARGEST_CURVE_ERROR, check_of_residuals
from pymc_hyperelastic.models.class_distribution import (
    SPREAD_OF_NOISE,
    ClassDistribution,
    check_class,
    distributions_of,
)
from pymc_hyperelastic.models.population import Population
from pymc_hyperelastic.models.settings import (
    ModelSettings,
    holds_inflation_data,
    inflation_data_of,
)
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws
from pymc_hyperelastic.models.study import Study
from pymc_hyperelastic.models.variability import Variability

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HierarchicalClass(Population, ClassKind):
    """Settings of classes with variability."""

    stored_as: ClassVar[str] = "specimen"
    has_p_value: ClassVar[bool] = True
    fresh_specimens: ClassVar[bool] = True

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts of the class distribution that these settings have, see ``PARTS``."""
        return parts_of(self)

    @property
    def in_words(self) -> str:
        """``"with experiment effect"`` if the experiments on a specimen differ, else ``""``."""
        return "with experiment effect" if self.variability.experiment_effect else ""

    @cached_property
    def reference(self) -> ClassDistribution:
        """Reference distribution under which each specimen is sampled."""
        return reference_of(self)

    def sampler(self, data: xr.Dataset) -> SpecimenSampler:
        """Return the sampler of single specimens of these data."""
        # Without an experiment effect all tests of a specimen share its parameters.
        by_test = self.variability.experiment_effect
        # Curves may be inaccurate for half of the prior's materials, such as those with fibres that
        # slacken within the wall: the integrator is refined for each specimen whose curves are
        # inaccurate, and a refined one takes a tenth of the time of pointwise quadrature.
        forward = self.forward_model(
            data, by_test=by_test, tolerance=LARGEST_CURVE_ERROR, inaccurate=0.5
        )
        return SpecimenSampler(self, forward, self.reference)

    def settings(self) -> ModelSettings:
        """Return the settings as they are stored in a result.

        Raises
        ------
        ValueError
            If a prior cannot be stored.
        """
        return ModelSettings.of(
            self.energy,
            self.priors or {},
            self.likelihood,
            self.geometry,
            variability=self.stored_as,
            **asdict(self.variability),
        )

    @classmethod
    def from_settings(cls, settings: ModelSettings) -> "HierarchicalClass":
        """Return the kind of a fitted class from its stored settings."""
        likelihood = settings.make_likelihood()
        if likelihood is None:
            raise ValueError("its likelihood is missing")
        return cls(
            settings.make_wall(),
            likelihood,
            Variability(settings.experiment_effect, settings.reference_stress),
            settings.make_priors(),
            settings.make_geometry(),
        )

    def check_stored(self, fitted: xr.DataTree) -> None:
        """Raise unless a class has an evidence, draws of its distribution, and no invalid data."""
        with reading(fitted):
            if holds_inflation_data(fitted):
                self.check(inflation_data_of(fitted))
            names = self.scale.names
        check_evidence(fitted)
        needed = ["location", "spread", *(SPREAD_OF_NOISE[noise] for noise in self.noises)]
        if self.variability.experiment_effect:
            needed += ["experiment_spread", "effect_spread"]
        check_class(fitted, names, needed)

    def fit(
        self,
        groups: Groups,
        draws: int,
        chains: int,
        seed: Seed,
        progressbar: bool = False,
        remember: Remember = compute_now,
    ) -> Iterator[tuple[str, xr.DataTree | Exception]]:
        """Sample the specimens and fit the distribution of one class after the other.

        Yields the name of each class with its result, or with the error that prevented it. See
        ``ClassKind.fit``.
        """
        check_count("draws", draws, FEWEST_DRAWS)
        check_count("chains", chains, 1)
        self.check_groups(groups)
        self.settings()
        return self._fitted(groups, draws, chains, seed, progressbar, remember)

    def _fitted(
        self,
        groups: Groups,
        draws: int,
        chains: int,
        seed: Seed,
        progressbar: bool,
        remember: Remember,
    ) -> Iterator[tuple[str, xr.DataTree | Exception]]:
        progress, model = create_simple_progress(progressbar), ClassModel(self)
        # One step for each specimen, for the first fit, and for each chain.
        steps = sum(len(specimens_of(data)[0]) + 1 + chains for data in groups.values())
        with progress:
            bar = progress.add_task("Fitting classes", completed=0, total=steps)
            advance = partial(progress.advance, bar)
            seeds = seed.spawn(len(groups))
            for i, ((name, data), class_seed) in enumerate(zip(groups.items(), seeds, strict=True)):
                rng, sampler = np.random.default_rng(class_seed), self.sampler(data)
                remember_part = named(f"class-{i}", remember)
                try:
                    specimens = sample_specimens(sampler, data, class_seed, advance, remember_part)
                    class_draws = draws_of_class(model, sampler, data, specimens, rng)
                    advance()
                    fitted = fit_distribution(
                        model, class_draws, draws, chains, class_seed, advance
                    )
                except (ValueError, ArithmeticError) as error:
                    yield name, error
                    continue
                fitted.attrs |= self.settings().attrs()
                for group, dataset in Study(self.energy, data, {}).groups().items():
                    fitted[group] = dataset
                yield name, fitted

    def predictor(self, classes: Fitted, like: xr.Dataset, seed: Seed) -> Predictor:
        """Return a function that samples a new specimen and predicts it under each class."""
        self.check(like, partial=True)
        predictive = SpecimenPredictive(self, classes, self.sampler(like))
        return lambda data, seed: predictive(data, np.random.default_rng(seed))

    def leave_out(
        self, groups: Groups, seed: Seed, remember: Remember = compute_now
    ) -> Callable[[Collection[str], int], Fold]:
        """Return a function that fits the classes without some specimens, and predicts these.

        All specimens are sampled once, here. A fold only fits the distributions of the classes. See
        ``ClassKind.leave_out``.
        """
        rng, model = np.random.default_rng(seed), ClassModel(self)
        samplers = {name: self.sampler(data) for name, data in groups.items()}
        specimens = {
            name: sample_specimens(
                samplers[name], data, seed, remember=named(f"class-{i}", remember)
            )
            for i, (name, data) in enumerate(groups.items())
        }
        all_draws = {
            name: draws_of_class(model, samplers[name], data, specimens[name], rng)
            for name, data in groups.items()
        }

        def fold(left_out: Collection[str], draws: int) -> Fold:
            fitted, fold_seed = {}, seed_of(seed, ", ".join(left_out))
            for name, class_draws in all_draws.items():
                kept = {s: d for s, d in class_draws.specimens.items() if s not in left_out}
                (class_seed,) = fold_seed.spawn(1)
                fitted[name] = fit_distribution(
                    model, class_draws._replace(specimens=kept), draws, 1, class_seed
                )
            rng = np.random.default_rng(*fold_seed.spawn(1))
            predictions = {}
            for name, data in groups.items():
                predictive = SpecimenPredictive(self, fitted, samplers[name])
                for specimen, part in specimens_apart(data, left_out).items():
                    predictions[specimen] = predictive(part, rng, specimens[name][specimen])
            return Fold.of(fitted, predictions)

        return fold

    def new_specimens(self, fitted: xr.DataTree, rng: np.random.Generator) -> dict[str, Array]:
        """Draw one new specimen from each posterior draw of the class distribution.

        Returns the material parameters by name, with the draws along the first axis.
        """
        draws = fresh_specimens(self, distributions_of(fitted), 1, rng)
        return self.scale.numbers([draws[name][:, 0] for name in self.scale.names])


def sample_specimens(
    sampler: SpecimenSampler,
    data: xr.Dataset,
    seed: Seed,
    advance: Callable[[], None] = no_progress,
    remember: Remember = compute_now,
) -> dict[str, SpecimenDraws]:
    """Sample each specimen of the data, and call `advance` after each.

    The draws of a specimen depend only on its own data and the seed. `remember` computes them, or
    reads them from a store.

    Raises
    ------
    ValueError
        If a specimen cannot be sampled. The message names it.
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


def checks_of_specimens(tree: xr.DataTree, evidence: xr.Dataset) -> list[Check]:
    """Check the residuals of each specimen, and the error that the draws of all specimens cause."""
    checks = []
    # Residuals are not compared with a noise that is inferred from them.
    if "specimens" in tree.children and not tree["specimens"].sizes.get("noise", 1):
        fits = tree["specimens"].to_dataset()
        checks.append(check_of_residuals(fits["misfit"], fits["freedom"]))
    if "specimens_se" in evidence:
        error = float(evidence["specimens_se"])
        words = (
            "the draws of a specimen may be wrong: it was given up, because its sampling did not "
            "converge or its curves are inaccurate for its material"
        )
        verdict = GOOD if error < np.inf else BAD
        checks.append(Check("specimens", error, np.inf, verdict, words))
    return checks


registered_checks.append(
    ModelChecks(
        checks_of_specimens,
        variables={"specimens_se": ()},
        together={"specimens_se": "specimens"},
        with_advice=("specimens",),
    )
)
