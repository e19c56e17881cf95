"""What was measured of a tube, and with which error."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import pymc as pm
import xarray as xr
from pytensor.graph.basic import Variable
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import (
    check_inflation_data,
)
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY, inferred_geometry
from pymc_hyperelastic.models.forward import ForwardModel, SymbolicTube
from pymc_hyperelastic.models.geometry import (
    check_held,
    check_known,
    check_measured,
    measured_of,
    priors_of,
)
from pymc_hyperelastic.models.observation.generative import register_measurements
from pymc_hyperelastic.models.observation.noise import (
    NOISE_UNITS,
    check_given,
    check_noise,
    in_sigmas,
)
from pymc_hyperelastic.models.observation.paper import paper_log_likelihood
from pymc_hyperelastic.models.observation.signals import OFFSET_VARIABLES, offsets_given
from pymc_hyperelastic.models.observation.slopes import check_slopes, with_slopes
from pymc_hyperelastic.models.priors import check_prior, is_inferred, register_prior

ErrorIn = Literal["pressure", "radius"]
Likelihood = Literal["paper", "generative"]


@dataclass(frozen=True)
class Observation:
    """What was measured of a tube, and with which error.

    Attributes
    ----------
    sigma, slope_weight, force_sigma : float or TensorVariable
        See :func:`~pymc_hyperelastic.inflation_model`; without `force_sigma` forces play no part.
    noise_sd, force_noise_sd : float or TensorVariable
        Standard deviations, one of which may be given in place of each ``σ``.
    error_in : {"pressure", "radius"}
        What was measured with an error.
    likelihood : {"paper", "generative"}
        How the data enter a model.
    """

    sigma: Any = None
    slope_weight: Any = 0.0
    force_sigma: Any = None
    error_in: ErrorIn = "pressure"
    likelihood: Likelihood = "paper"
    noise_sd: Any = None
    force_noise_sd: Any = None
    force_offset_sd: Any = None
    diameter_noise_sd: Any = None

    def __post_init__(self) -> None:
        check_given(self.noise)

    @property
    def noise(self) -> dict[str, Any]:
        """What is said of the errors, by the name by which it was given."""
        noise = {name: getattr(self, name) for name in NOISE_UNITS}
        return {
            name: value
            for name, value in noise.items()
            if value is not None or name == "slope_weight"
        }

    @property
    def sigmas(self) -> dict[str, Any]:
        """The same, every size of errors as the paper's ``σ``."""
        return in_sigmas(self.noise)

    @property
    def with_force(self) -> bool:
        """Whether axial forces play a part."""
        return "force_sigma" in self.sigmas

    @property
    def with_slopes(self) -> bool:
        """Whether slopes of the curves play a part: measured, or by what an error moves."""
        return with_slopes(self.slope_weight) or self.diameter_noise_sd is not None

    @property
    def signals(self) -> tuple[str, ...]:
        """What was measured, as far as it plays a part; slopes are those of the pressures."""
        there = {"slope": with_slopes(self.slope_weight), "force": self.with_force}
        return ("pressure", *(name for name, plays in there.items() if plays))

    def measured(self, data: xr.Dataset) -> list[str]:
        """Which of the signals these data have."""
        known = {"force": self.with_force and bool(data["axial_force"].notnull().any())}
        return [name for name in self.signals if known.get(name, True)]

    def check(
        self,
        wall: StrainEnergy | Sequence[Layer],
        data: xr.Dataset,
        parameters: Mapping[str, Any],
        geometry: Mapping[str, Any] | None = None,
    ) -> None:
        """Raise unless these data can have been measured so of this wall.

        The `geometry` may hold what :func:`~pymc_hyperelastic.inflation_model` infers.
        """
        if self.likelihood not in get_args(Likelihood):
            raise ValueError(
                f"likelihood is {self.likelihood!r}; expected one of {get_args(Likelihood)}"
            )
        if isinstance(wall, StrainEnergy):
            _check_parameters(wall, parameters)
        check_inflation_data(data)
        _check_geometry(wall, data, geometry)
        for name, value in self.noise.items():
            check_noise(name, value)
        if self.with_force and ("axial_force" not in data or data["axial_force"].isnull().all()):
            name = "force_sigma" if self.force_noise_sd is None else "force_noise_sd"
            raise ValueError(
                f"{name} is given, but the data hold no axial forces: add a column 'axial_force'"
            )
        self._check_form(data)

    def _check_form(self, data: xr.Dataset) -> None:
        """Raise unless slopes, errors and the likelihood go together."""
        if self.error_in not in get_args(ErrorIn):
            raise ValueError(f"error_in is {self.error_in!r}; expected one of {get_args(ErrorIn)}")
        if self.error_in == "radius" and with_slopes(self.slope_weight):
            raise ValueError(
                f"slope_weight is {self.slope_weight}, but with error_in='radius' slopes play no "
                "part: expected 0"
            )
        if self.diameter_noise_sd is not None:
            self._check_diameter_noise()
        if with_slopes(self.slope_weight):
            check_slopes(data)
        if self.likelihood == "paper":
            return
        if self.error_in == "radius":
            raise ValueError(
                "with likelihood='generative' the measured pressures are drawn at known radii: "
                "leave error_in='radius' away, or take likelihood='paper'"
            )
        if isinstance(self.slope_weight, Variable):
            raise ValueError(
                "with likelihood='generative' slope_weight must be a number of mm², such as "
                "ph.balanced_slope_weight(data), and no distribution: it is part of the "
                "covariance, which is factorised once; take likelihood='paper' to infer it"
            )

    def _check_diameter_noise(self) -> None:
        """Raise if an error of the diameter is stated twice, or slopes would share it."""
        if self.error_in == "radius":
            raise ValueError(
                "with error_in='radius' noise_sd is the error of the measured radius (mm), and "
                "pressures have none: leave diameter_noise_sd away, or give it with the error of "
                "the pressures as noise_sd (kPa) and leave error_in away"
            )
        if with_slopes(self.slope_weight):
            raise ValueError(
                f"slope_weight is {self.slope_weight}, but with diameter_noise_sd slopes play no "
                "part: they are differences of pressures over radii that have an error each; "
                "expected 0"
            )

    def forward_model(
        self,
        wall: StrainEnergy | Sequence[Layer],
        data: xr.Dataset,
        parameters: Mapping[str, Any],
        geometry: Mapping[str, Any] | None = None,
        **settings: Any,
    ) -> ForwardModel:
        """Forward model of what is observed, see :class:`ForwardModel` for the arguments."""
        settings |= {"with_force": self.with_force, "error_in": self.error_in}
        return ForwardModel(wall, data, parameters, geometry, **settings)

    def with_variables(self) -> "Observation":
        """The same with random variables of the model in context in place of distributions."""
        registered = {}
        for name, value in self.noise.items():
            if is_inferred(value):
                check_prior(name, value, model=pm.modelcontext(None))
                registered[name] = register_prior(name, value)
        return replace(self, **registered)

    def register(
        self, tube: SymbolicTube, curves: Mapping[str, TensorVariable], **settings: Any
    ) -> None:
        """Add what was measured to the model in context: a Potential, or observed variables.

        With it what is learned of offsets, see :func:`~pymc_hyperelastic.force_offsets`. The
        `settings` are those of :func:`register_measurements`.
        """
        if self.likelihood == "generative":
            register_measurements(tube, curves, **self.sigmas, **settings)
        else:
            pm.Potential("likelihood", self.log_likelihood(tube))
        if self.force_offset_sd is not None:
            tests = pm.modelcontext(None).name_for("test")
            errors = {name: v for name, v in self.sigmas.items() if name != "slope_weight"}
            known = offsets_given(tube, curves, **errors)
            for name, values in zip(OFFSET_VARIABLES, known, strict=True):
                pm.Deterministic(name, values, dims=tests)

    def log_likelihood(
        self, tube: SymbolicTube, switches: Mapping[str, Any] | None = None
    ) -> TensorVariable:
        """The paper's log-likelihood, see :func:`~pymc_hyperelastic.inflation_likelihood`.

        With `switches`, it is that of the :attr:`signals` whose switch is not 0.
        """
        return paper_log_likelihood(tube, **self.sigmas, switches=switches)


def _check_parameters(energy: StrainEnergy, parameters: Mapping[str, Any]) -> None:
    if not isinstance(parameters, Mapping):
        raise TypeError(
            f"parameters must be a dict with the keys {list(energy.parameter_names)}, not "
            f"{type(parameters).__name__}"
        )
    energy.split(parameters)


def _check_geometry(
    wall: StrainEnergy | Sequence[Layer], data: xr.Dataset, geometry: Mapping[str, Any] | None
) -> None:
    """Raise unless the tube is known, but for what is inferred of it."""
    check_measured(data, measured_of(geometry or {}), not isinstance(wall, StrainEnergy))
    inferred = inferred_geometry(priors_of(geometry or {}))
    needed = set(GEOMETRY) - set(inferred)
    if not isinstance(wall, StrainEnergy):
        needed.discard("outer_radius")
        if "outer_radius" in inferred or not data["outer_radius"].isnull().all():
            raise ValueError(
                "layers state the thickness of the wall, and the data its outer radius: leave that "
                "away, ph.inflation_data(..., outer_radius=None)"
            )
    if "axial_stretch" in inferred:
        then = (
            ", in which it was measured, and geometry holds one value for all tests: leave it out"
        )
        check_held(data, then)
    for name in sorted(needed):
        prior = f"give it a prior, geometry={{{name!r}: ...}}"
        check_known(data, name, f": state it with the data, or {prior}")
