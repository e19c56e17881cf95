"""How large errors are: as a standard deviation, or as the paper's ``σ``, which is ``√2`` of it.

Models compute with ``σ``. What was given as a standard deviation becomes one here, and nowhere
else. The same holds for forces, and for errors in the radius: no density has a factor ½.
"""

from collections.abc import Mapping
from math import isfinite
from numbers import Real
from typing import Any

import numpy as np
from pytensor.graph.basic import Variable

from pymc_hyperelastic.models.priors import is_inferred

# What is said of the errors, and the unit that it has.
NOISE_UNITS = {
    "sigma": "kPa",
    "noise_sd": "kPa",
    "slope_weight": "mm2",
    "force_sigma": "mN",
    "force_noise_sd": "mN",
    "force_offset_sd": "mN",
    "diameter_noise_sd": "mm",
}
# The paper's name of what is given as a standard deviation.
SIGMA_OF = {"noise_sd": "sigma", "force_noise_sd": "force_sigma"}
_SD_OF = {sigma: sd for sd, sigma in SIGMA_OF.items()}
_EXPECTED = {
    "sigma": "a positive number of kPa (5 mmHg is 5 * ph.mmHg)",
    "slope_weight": "a number of mm², 0 to leave the slopes out",
    "force_sigma": "a positive number of mN",
    "noise_sd": "a standard deviation, a positive number of kPa (2 mmHg is 2 * ph.mmHg)",
    "force_noise_sd": "a standard deviation, a positive number of mN",
    "force_offset_sd": "a standard deviation, a positive number of mN (without offsets, leave it "
    "away)",
    "diameter_noise_sd": "a standard deviation, a positive number of mm (of a diameter that is "
    "known, leave it away)",
}
# What is said of those that are no errors of one measurement.
_OF_WHAT = {
    "force_offset_sd": "one standard deviation of the transducer's offset, one for each test",
    "diameter_noise_sd": "one standard deviation of a measured diameter",
}


def sigma_of_sd(sd: Any) -> Any:
    """The paper's ``σ`` of a standard deviation."""
    return sd * np.sqrt(2.0)


def sd_of_sigma(sigma: Any) -> Any:
    """The standard deviation of the paper's ``σ``."""
    return sigma / np.sqrt(2.0)


def in_sigmas(noise: Mapping[str, Any]) -> dict[str, Any]:
    """What is said of the errors, every size of them as the paper's ``σ``."""
    return {
        SIGMA_OF.get(name, name): sigma_of_sd(value) if name in SIGMA_OF else value
        for name, value in noise.items()
    }


def to_store(noise: Mapping[str, Any]) -> dict[str, Any]:
    """The same with numbers as ``σ``, however they were given, and distributions as given.

    Classes of one noise are then stored alike.
    """
    stored: dict[str, Any] = {}
    for name, value in noise.items():
        stored |= {name: value} if is_inferred(value) else in_sigmas({name: value})
    return stored


def noise_in_words(noise: Mapping[str, Any], error_in: str = "pressure") -> str:
    """What is said of the errors, as ``σ`` and as standard deviations.

    >>> from pymc_hyperelastic.models.observation.noise import noise_in_words
    >>> noise_in_words({"noise_sd": 0.5, "slope_weight": 0.0})
    'sigma = 0.707107 kPa (a standard deviation of 0.5 kPa), slope_weight = 0 mm2'
    """
    units = NOISE_UNITS | ({"sigma": "mm", "noise_sd": "mm"} if error_in == "radius" else {})
    said = []
    for name, value in to_store(noise).items():
        unit = units[name]
        what = f"{name} inferred, in {unit}" if is_inferred(value) else f"{name} = {value:g} {unit}"
        if name in _OF_WHAT:
            what += f" ({_OF_WHAT[name]})"
        elif name in SIGMA_OF:
            what += " (one standard deviation)"
        elif name in _SD_OF and is_inferred(value):
            what += " (√2 standard deviations)"
        elif name in _SD_OF:
            what += f" (a standard deviation of {sd_of_sigma(value):g} {unit})"
        said.append(what)
    return ", ".join(said)


def check_given(noise: Mapping[str, Any]) -> None:
    """Raise TypeError unless each error is given once, and that of the pressure at all.

    What is not given is None, or left away.
    """
    given = {name for name, value in noise.items() if value is not None}
    if not given & {"sigma", "noise_sd"}:
        raise TypeError(
            "sigma is None, and so is noise_sd: give noise_sd, the standard deviation of the "
            "errors (kPa), or sigma, the paper's σ, which is √2 standard deviations"
        )
    for sd, paper in SIGMA_OF.items():
        if {sd, paper} <= given:
            raise TypeError(
                f"both {sd} and {paper} are given, and say the same: give {sd}, a standard "
                f"deviation, or {paper}, which is √2 standard deviations"
            )
    if "force_offset_sd" in given and not given & {"force_sigma", "force_noise_sd"}:
        raise TypeError(
            "force_offset_sd is given, but without an error of the forces these play no part: give "
            "force_noise_sd, the standard deviation of what differs from point to point (mN)"
        )


def check_noise(name: str, value: Any) -> None:
    """Raise unless an error has a size, or a distribution of one."""
    expected = _EXPECTED[name]
    if isinstance(value, Variable):
        if value.type.ndim:
            raise TypeError(
                f"{name} has {value.type.ndim} dimension(s); expected {expected}, or a scalar "
                "distribution"
            )
        return
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{name} is {value!r}; expected {expected}, or a distribution")
    if not isfinite(value) or value < 0 or (name != "slope_weight" and value == 0):
        raise ValueError(f"{name} is {value}; expected {expected}")
