"""The interface of forward models, and the arrays of data that their expressions share."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable
from copy import copy
from typing import Any, ClassVar, Self

import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.compile.sharedvalue import SharedVariable
from pytensor.graph.basic import Variable

from pymc_hyperelastic.models.forward.tube_variables import Array, Arrays, Curves, Values


class SymbolicTests(ABC):
    """Tests of a material, and perhaps a geometry, that are variables of a model."""

    of_sheets: ClassVar[bool] = False

    @property
    def parts(self) -> "list[Any]":
        """Tests of tubes, and tests of sheets, each by themselves."""
        return [self]

    @abstractmethod
    def curves(self) -> Curves:
        """Return the curves at the measured points, by name."""


class ForwardModel(ABC):
    """Curves of tests at the measured points, for any parameters of the material.

    The data enter compiled expressions as shared variables: :meth:`set_data` replaces them.

    Parameters
    ----------
    data : xarray.Dataset
        The tests.
    by_test : bool
        If True, each test has parameters of its own: vectors with one entry for each test.
    replaceable : bool
        If True, other data may replace these. If False, terms that depend on the data alone are
        computed when a function is compiled.
    """

    error_in: str = "pressure"
    of_sheets: ClassVar[bool] = False

    def __init__(self, data: xr.Dataset, *, by_test: bool = False, replaceable: bool = True):
        self.data, self.by_test = data, by_test
        self._replaceable = replaceable
        self._shared: dict[Hashable, tuple[Callable, dict[str, SharedVariable]]] = {}

    @property
    def parts(self) -> "list[ForwardModel]":
        """Forward models of tests of tubes, and of sheets."""
        return [self]

    @property
    @abstractmethod
    def unknown(self) -> tuple[list[str], list[str]]:
        """Names of the unknown material parameters, and of the unknown geometry."""

    @abstractmethod
    def errors(self, data: xr.Dataset, parameters: Values, geometry: Values | None = None) -> Array:
        """Return the largest error of the curves of each material, see :meth:`Integrator.errors`.

        The `parameters` and the unknown `geometry` are given by name, with one number for each
        material. A geometry that is missing is the measured one.
        """

    @abstractmethod
    def refined(
        self, data: xr.Dataset, parameters: Values, geometry: Values | None = None
    ) -> "ForwardModel":
        """Return the same with curves that are accurate for these materials, too."""

    @abstractmethod
    def with_variables(
        self, parameters: Values, geometry: Values | None = None, deviations: Values | None = None
    ) -> SymbolicTests:
        """The tests with variables of a model in place of the distributions.

        The `deviations` of the measured geometry, in standard deviations, are vectors with one
        entry for each test.
        """

    def with_data(self, data: xr.Dataset) -> "ForwardModel":
        """The same for other data of the same kind, at other radii say."""
        return self._changed(data=data)

    def set_data(self, data: xr.Dataset) -> None:
        """Replace the data by others of the same kind, in all compiled expressions."""
        if not self._replaceable:
            raise TypeError("these data are constants here: make the forward model replaceable")
        if data is self.data:
            return
        self.data = data
        for arrays_of, inputs in self._shared.values():
            arrays = arrays_of(data)
            if arrays.keys() != inputs.keys():
                raise ValueError(f"these data are of another kind: {sorted(arrays)} are measured")
            for name, value in arrays.items():
                inputs[name].set_value(value, borrow=True)

    def share(
        self,
        key: Hashable,
        arrays_of: Callable[[xr.Dataset], Arrays],
        make: Callable[[NDArray, str], Any] | None = None,
    ) -> dict[str, SharedVariable]:
        """Shared variables of arrays that are made of the data, and follow them.

        Shared variables of the same `key` are returned again. Data of other lengths
        may replace these.
        """
        if key not in self._shared:
            make = make or (pt.constant if self._folded else _shared_variable)
            inputs = {name: make(value, name) for name, value in arrays_of(self.data).items()}
            self._shared[key] = arrays_of, inputs
        return self._shared[key][1]

    @property
    def _folded(self) -> bool:
        """True if arrays of the data are constants."""
        return not self._replaceable

    def _changed(self, **attributes: Any) -> Self:
        other = copy(self)
        vars(other).update(attributes, _shared={})
        return other


def _shared_variable(value: NDArray, name: str) -> Variable:
    return pytensor.shared(value, name=name, shape=(None,) * value.ndim)
