"""State the pressures, the tube and the fluid for which properties of a tube are computed.

Predictions, comparisons of classes, planned tests, figures and reports take :class:`Conditions`, or
plain pressures in kPa.
"""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, fields
from numbers import Real
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.plausible import check_plausible_pressures
from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.data.validation import Check
from pymc_hyperelastic.mechanics.reference_tube import Tube
from pymc_hyperelastic.predictions.draws import checked_numbers, stated_geometry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Conditions:
    """Pressures, tube and fluid for which properties of a tube are computed.

    Functions with an argument `at` take :class:`Conditions`, or pressures in kPa: ``at=12`` is
    short for ``at=ph.Conditions(12)``.

    Parameters
    ----------
    pressure : float or sequence of float, optional
        Internal pressures at which properties are computed, in `pressure_unit`.
    pressure_range : pair of float, optional
        Diastolic and systolic pressure, in `pressure_unit`, for the properties that depend on two
        pressures: the in vivo axial stretch and the change of the stored energy.
    pressure_unit : str, default "kPa"
        Unit of `pressure` and `pressure_range`, as pint names it, such as ``"mmHg"``, and of the
        same pressures in results and figures. Stresses and moduli are in kPa.
    tube : Tube, optional
        The tube for which properties are computed. A measure that is not stated is that of the
        specimen; in :func:`compare_classes`, :func:`plan_study` and :func:`expected_information` it
        is the median over the specimens.
    density : float, default 1060
        Density of the fluid in the tube, kg/m³, for the pulse wave velocity; by default the density
        of blood.

    Raises
    ------
    TypeError
        If `tube` is no :class:`Tube`, or one of its measures no number.
    ValueError
        If a pressure is no finite number, `pressure_range` is not a pair of increasing pressures of
        at least 0, the unit is unknown, the density is not positive, or the tube states radii that
        depend on an opening angle without this angle.

    See Also
    --------
    tube_properties, compare_classes, Tube

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> ph.Conditions(100, pressure_range=(80, 120), pressure_unit="mmHg")
    Conditions(pressure=100.0, pressure_range=(80.0, 120.0), pressure_unit='mmHg')
    >>> ph.Conditions([10, 12], tube=ph.Tube(7.0, 9.0))
    Conditions(pressure=(10.0, 12.0), tube=Tube(inner_radius=7.0, outer_radius=9.0))
    """

    pressure: Any = None
    _: KW_ONLY
    pressure_range: Any = None
    pressure_unit: str = "kPa"
    tube: Tube | None = None
    density: float = 1060.0

    def __post_init__(self) -> None:
        to_internal(1.0, self.pressure_unit, "pressure")  # raise if the unit is unknown
        # Numbers and tuples can be compared and printed, which arrays cannot.
        if self.pressure is not None:
            expected = f"pressures in {self.pressure_unit}"
            numbers = checked_numbers("pressure", self.pressure, expected).tolist()
            pressure = tuple(numbers) if np.ndim(self.pressure) else numbers[0]
            object.__setattr__(self, "pressure", pressure)
        if self.pressure_range is not None:
            object.__setattr__(self, "pressure_range", self._checked_range())
        self.geometry()  # raise if a measure is no number
        if not (isinstance(self.density, Real) and 0 < self.density < np.inf):
            raise ValueError(f"density must be a positive number in kg/m³; got {self.density!r}")

    def __repr__(self) -> str:
        stated = {f.name: getattr(self, f.name) for f in fields(self)}
        changed = [f.name for f in fields(self) if stated[f.name] != f.default]
        return f"Conditions({', '.join(f'{name}={stated[name]!r}' for name in changed)})"

    @property
    def pressures(self) -> Array:
        """Pressures in `pressure_unit`, as an array.

        Raises
        ------
        ValueError
            If no pressure is stated.
        """
        if self.pressure is None:
            raise ValueError(
                "at states no pressure: give pressures in kPa, such as at=12, or with their unit, "
                "such as at=ph.Conditions(90, pressure_unit='mmHg')"
            )
        return np.atleast_1d(np.asarray(self.pressure, float))

    def in_kilopascal(self, check: Check | None = None) -> Array:
        """Return the pressures in kPa; `check` decides about implausibly large ones.

        Functions without an argument `check` warn of them, and pass None.
        """
        return self._converted(self.pressures, check)

    def range_in_kilopascal(self, check: Check | None = None) -> Array:
        """Return the diastolic and the systolic pressure in kPa, as :meth:`in_kilopascal` does."""
        return self._converted(self.pressure_range, check)

    def geometry(self) -> dict[str, Any]:
        """Return the stated radii (mm), axial stretch and opening angle (rad) of the tube."""
        return {} if self.tube is None else stated_geometry(self.tube)

    def label_pressures(self, found: xr.Dataset) -> xr.Dataset:
        """Return a prediction whose coordinate ``pressure`` is in `pressure_unit`."""
        values = np.broadcast_to(self.pressures, found["pressure"].shape)
        attributes = found["pressure"].attrs | {"units": self.pressure_unit}
        return found.assign_coords(pressure=("pressure", values, attributes))

    def _converted(self, pressures: Any, check: Check | None) -> Array:
        converted = to_internal(pressures, self.pressure_unit, "pressure")
        check_plausible_pressures(converted, check)
        return converted

    def _checked_range(self) -> tuple[float, float]:
        """Return the diastolic and the systolic pressure; raise unless they increase."""
        expected = f"two pressures in {self.pressure_unit}"
        numbers = checked_numbers("pressure_range", self.pressure_range, expected).tolist()
        if len(numbers) != 2 or not 0 <= numbers[0] < numbers[1]:
            raise ValueError(
                "pressure_range must be a diastolic and a higher systolic pressure in "
                f"{self.pressure_unit}; got {self.pressure_range!r}"
            )
        return numbers[0], numbers[1]


def as_conditions(at: Conditions | float | Sequence[float] | Any) -> Conditions:
    """Return conditions; a number or a list are pressures in kPa, and None states nothing.

    Raises
    ------
    TypeError
        If `at` is a tube or a dict.
    ValueError
        If a pressure is no finite number.
    """
    if isinstance(at, Conditions):
        return at
    if isinstance(at, Tube):
        raise TypeError(f"at is {at}: a tube is stated as at=ph.Conditions(pressure, tube={at})")
    if isinstance(at, dict):
        raise TypeError(
            f"at is {at!r}; expected pressures in kPa, or ph.Conditions(90, pressure_unit='mmHg')"
        )
    return Conditions(at)
