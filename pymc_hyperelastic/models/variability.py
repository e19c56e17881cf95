"""How the specimens of a class differ, as users state it for models and fits."""

from dataclasses import dataclass
from math import inf
from numbers import Real
from typing import Any


@dataclass(frozen=True)
class Variability:
    """How the specimens of a class differ: each has its own material parameters.

    The parameters of the specimens are drawn from a class distribution, which is normal in natural
    coordinates of the material: the logarithm of the reference strain in place of the first
    modulus, and logarithms, or other transformations, of the other parameters. The reference strain
    is the strain at which the wall has the reference stress.

    Parameters
    ----------
    experiment_effect : bool, default False
        If True, the tests of one specimen differ by more than noise, as at several axial stretches
        if the law does not describe the coupling of the directions.
    reference_stress : float or None, default 20
        Reference stress, kPa. With None each modulus has its own logarithm as a coordinate. The
        evidences of both choices show in which coordinates the specimens are closer to normal.

    Raises
    ------
    TypeError
        If `experiment_effect` is neither True nor False.
    ValueError
        If the reference stress is not a positive number.

    See Also
    --------
    fit_classes, population_model, cross_validate

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), group="C1")
    >>> variability = ph.Variability(experiment_effect=True)
    >>> model = ph.population_model(ph.NeoHookean(), data, 0.5, variability=variability)
    >>> [rv.name for rv in model.free_RVs][:4]
    ['location', 'spread', 'experiment_spread', 'effect_spread']
    """

    experiment_effect: bool = False
    reference_stress: float | None = 20.0

    def __post_init__(self) -> None:
        if not isinstance(self.experiment_effect, bool):
            raise TypeError(
                f"experiment_effect is {self.experiment_effect!r}; expected True or False"
            )
        stress = self.reference_stress
        if stress is not None and not (isinstance(stress, Real) and 0 < stress < inf):
            raise ValueError(
                f"reference_stress is {stress!r}; expected a positive number of kPa, or None for "
                "the logarithm of each modulus"
            )


def as_variability(value: Any) -> Variability:
    """Return the argument `variability` of a user as a :class:`Variability`.

    TypeError or ValueError if it is neither a :class:`Variability` nor ``"specimen"``.
    """
    if isinstance(value, Variability):
        return value
    if isinstance(value, str) and value == "specimen":
        return Variability()
    error = ValueError if isinstance(value, str) else TypeError
    raise error(
        f"variability is {value!r}; expected ph.Variability(...), or 'specimen', which is short "
        "for ph.Variability(). Fits of classes also take None: all specimens share one material"
    )
