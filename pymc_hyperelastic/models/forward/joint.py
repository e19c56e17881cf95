"""The forward model of tests of tubes and of sheets of one material."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import pymc as pm
import xarray as xr

from pymc_hyperelastic.data.sheets import sheet_tests, sheets_of, tubes_of
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.models.forward.base import ForwardModel, SymbolicTests
from pymc_hyperelastic.models.forward.model import SymbolicTube, TubeForward
from pymc_hyperelastic.models.forward.sheets import SheetForward, SymbolicSheets
from pymc_hyperelastic.models.forward.tube_variables import Array, Arrays, Curves, Values
from pymc_hyperelastic.models.geometry import of_sheets, of_tubes
from pymc_hyperelastic.models.priors import is_inferred


def forward_model(
    wall: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    parameters: Values,
    geometry: Values | None = None,
    *,
    by_test: bool = False,
    replaceable: bool = True,
    **settings_of_tubes: Any,
) -> ForwardModel:
    """Return the forward model of tests of tubes, of sheets, or of both.

    Arguments are those of :class:`TubeForward`.
    """
    tubes, sheets = tubes_of(data), sheets_of(data)
    settings: dict[str, Any] = {"by_test": by_test, "replaceable": replaceable}
    forward = None
    if tubes is not None:
        settings_of_tubes |= {"geometry": of_tubes(geometry)}
        forward = TubeForward(wall, tubes, parameters, **settings, **settings_of_tubes)
        if sheets is None:
            return forward
    if not isinstance(wall, StrainEnergy):
        raise ValueError(
            "the data hold tests of sheets, which are modelled as one material: give a strain "
            "energy in place of layers, or leave these tests out"
        )
    settings |= {n: v for n, v in settings_of_tubes.items() if n in ("tolerance", "inaccurate")}
    other = SheetForward(wall, sheets, parameters, of_sheets(geometry), **settings)
    return other if forward is None else JointForward(wall, data, forward, other)


def points_of_part(tests: SymbolicTests, part: Any, dims: str | None) -> str | None:
    """Return the dimension of the points, or the tests, of a part in the model of the context.

    It is `dims` if there is one part, and else such as ``"tube_obs"``, or ``"sheet_test"``.
    """
    if dims is None or len(tests.parts) == 1:
        return dims
    model, kind = pm.modelcontext(None), "sheet" if part.of_sheets else "tube"
    return model.name_for(f"{kind}_{dims.rpartition('::')[2]}")


def register_curves(tests: SymbolicTests, dims: str | None) -> Curves:
    """Add the curves of tests to the model of the context, over their points."""
    found: Curves = {}
    for part in tests.parts:
        own = points_of_part(tests, part, dims)
        found |= {n: pm.Deterministic(n, curve, dims=own) for n, curve in part.curves().items()}
    return found


class JointForward(ForwardModel):
    """Tests of tubes and of sheets, each by its own forward model, with the same parameters."""

    def __init__(
        self, energy: StrainEnergy, data: xr.Dataset, tubes: TubeForward, sheets: SheetForward
    ) -> None:
        super().__init__(data, by_test=tubes.by_test)
        self.energy, self.tubes, self.sheets = energy, tubes, sheets
        self.error_in = tubes.error_in

    @property
    def parts(self) -> list[ForwardModel]:
        """The forward models of tubes and of sheets."""
        return [self.tubes, self.sheets]

    @property
    def unknown(self) -> tuple[list[str], list[str]]:
        """Names of the unknown material parameters, and of the unknown geometry of the tubes."""
        return self.tubes.unknown

    def errors(self, data: xr.Dataset, parameters: Values, geometry: Values | None = None) -> Array:
        """Return the largest error of the curves of each material."""
        errors = np.zeros(1)
        for part, own in ((self.tubes, tubes_of(data)), (self.sheets, sheets_of(data))):
            if own is not None:
                errors = np.maximum(errors, part.errors(own, parameters, geometry))
        return errors

    def refined(
        self, data: xr.Dataset, parameters: Values, geometry: Values | None = None
    ) -> "JointForward":
        """Return the same with curves that are accurate for these materials, too."""
        tubes, sheets = tubes_of(data), sheets_of(data)
        parts: dict[str, ForwardModel] = {}
        if tubes is not None:
            parts["tubes"] = self.tubes.refined(tubes, parameters, geometry)
        if sheets is not None:
            parts["sheets"] = self.sheets.refined(sheets, parameters)
        return self._changed(**parts)

    def with_data(self, data: xr.Dataset) -> ForwardModel:
        """The same for other data: the model of one kind of tests if there is one kind."""
        tubes, sheets = tubes_of(data), sheets_of(data)
        if tubes is None:
            return self.sheets.with_data(sheets)
        if sheets is None:
            return self.tubes.with_data(tubes)
        parts = {"tubes": self.tubes.with_data(tubes), "sheets": self.sheets.with_data(sheets)}
        return self._changed(data=data, **parts)

    def set_data(self, data: xr.Dataset) -> None:
        """Replace the data by others of both kinds, in all compiled expressions."""
        super().set_data(data)
        self.tubes.set_data(tubes_of(data))
        self.sheets.set_data(sheets_of(data))

    def with_variables(
        self, parameters: Values, geometry: Values | None = None, deviations: Values | None = None
    ) -> "SymbolicJoint":
        """The tests with variables of a model in place of the distributions."""
        tests = self.share("tests of each kind", _tests_of_each_kind)

        def variables_of(tests: Any) -> tuple[Values, Values | None, Values]:
            entries = self.energy.split(parameters)
            if self.by_test:
                entries = [entry[tests] if is_inferred(entry) else entry for entry in entries]
            z = {name: values[tests] for name, values in (deviations or {}).items()}
            return self.energy.join(entries), geometry, z

        return SymbolicJoint(
            self,
            self.tubes.with_variables(*variables_of(tests["tubes"])),
            self.sheets.with_variables(*variables_of(tests["sheets"])),
        )


@dataclass(frozen=True)
class SymbolicJoint(SymbolicTests):
    """Tubes and sheets of variable material at the points of the data."""

    forward: JointForward
    tubes: SymbolicTube
    sheets: SymbolicSheets

    @property
    def parts(self) -> list[SymbolicTube | SymbolicSheets]:
        """Tests of tubes, and tests of sheets."""
        return [self.tubes, self.sheets]

    def curves(self) -> Curves:
        """Return the curves of tubes and of sheets, each at its own points."""
        return dict(chain.from_iterable(part.curves().items() for part in self.parts))


def _tests_of_each_kind(data: xr.Dataset) -> Arrays:
    sheets = sheet_tests(data)
    return {"tubes": np.flatnonzero(~sheets), "sheets": np.flatnonzero(sheets)}
