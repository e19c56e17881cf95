"""The forward model of sheets: stresses under the measured stretches."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.variables import nominal_points
from pymc_hyperelastic.mechanics.sheet import stresses_at
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy, elementwise_derivative
from pymc_hyperelastic.models.forward.base import ForwardModel, SymbolicTests
from pymc_hyperelastic.models.forward.choose import Mode
from pymc_hyperelastic.models.forward.tabulated_sheets import tabulated_sheets
from pymc_hyperelastic.models.forward.tube_variables import (
    Array,
    Arrays,
    Curves,
    Points,
    Values,
    WallVariables,
)
from pymc_hyperelastic.models.geometry import MeasuredValue
from pymc_hyperelastic.models.priors import is_inferred

# Points by the directions in which their stretch is known: the other direction is free.
_BLOCKS = {"both": (True, True), "only_x": (True, False), "only_y": (False, True)}


class SheetForward(ForwardModel):
    """Stresses of sheets at the measured stretches, for any parameters.

    The arguments are those of :class:`TubeForward`; the `measures` have relative errors. Stresses
    are computed at every point; misfits of many points with known stretches from a `table`, see
    :class:`TabulatedSheets`, unless the `mode` is ``"quadrature"``.
    """

    of_sheets = True

    def __init__(
        self,
        energy: StrainEnergy,
        data: xr.Dataset,
        parameters: Values,
        measures: Mapping[str, MeasuredValue] | None = None,
        *,
        by_test: bool = False,
        mode: Mode = "auto",
        tolerance: float = 1e-9,
        inaccurate: float = 1 / 200,
        replaceable: bool = True,
    ) -> None:
        super().__init__(data, by_test=by_test, replaceable=replaceable)
        self.energy, self._names = energy, [*parameters]
        self.sds = {name: value.sd for name, value in (measures or {}).items()}
        self.table = None
        if not by_test and not self.sds and mode != "quadrature":
            settings = {"tolerance": tolerance, "inaccurate": inaccurate}
            self.table = tabulated_sheets(energy, data, parameters, **settings)
        self.blocks = [name for name, rows in _rows_of_blocks(data).items() if rows.size]

    @property
    def unknown(self) -> tuple[list[str], list[str]]:
        """Names of the unknown material parameters, and of no geometry."""
        return self._names, []

    def errors(self, data: xr.Dataset, parameters: Values, geometry: Values | None = None) -> Array:
        """Return the largest error of the stresses of each material; 0 without a table."""
        if self.table is None:
            return np.zeros(1)
        materials = WallVariables(self.energy, dict(parameters), {}).materials
        return self.table.errors(data, materials)

    def refined(
        self, data: xr.Dataset, parameters: Values, geometry: Values | None = None
    ) -> "SheetForward":
        """Return the same without a table, whose stresses are exact."""
        return self._changed(table=None)

    def with_variables(
        self, parameters: Values, geometry: Values | None = None, deviations: Values | None = None
    ) -> "SymbolicSheets":
        """The sheets with variables of a model in place of the distributions."""
        return SymbolicSheets(self, parameters, deviations or {})

    def arrays(self, data: xr.Dataset) -> Arrays:
        """Return the arrays of the data for the stresses of each block of points."""
        blocks = _rows_of_blocks(data)
        for name, rows in blocks.items():
            if rows.size and name not in self.blocks:
                raise ValueError(
                    "in these data a sheet is free in a direction in which none was free in the "
                    "data of the model: make the model of data that hold such tests"
                )
        logs = {axis: np.log(data[f"stretch_{axis}"].values.astype(float)) for axis in "xy"}
        nominal = nominal_points(data)
        found: Arrays = {
            # Position of each point among the points of all blocks.
            "place": np.argsort(np.concatenate([blocks[name] for name in self.blocks]))
        }
        for block in self.blocks:
            rows = blocks[block]
            found[f"{block}_test"] = data["test"].values[rows]
            found[f"{block}_nominal"] = nominal[rows].astype(float)
            for axis, known in zip("xy", _BLOCKS[block], strict=True):
                if known:
                    found[f"{block}_{axis}"] = logs[axis][rows]
        return found


@dataclass(frozen=True)
class SymbolicSheets(SymbolicTests):
    """Sheets of variable material at the points of the data."""

    of_sheets = True

    forward: SheetForward
    parameters: Mapping[str, Any]
    deviations: Mapping[str, Any]
    """Errors of the measures, in standard deviations, by name and of each test."""

    def curves(self) -> Curves:
        """Stresses ``stress_x`` and ``stress_y`` at the points, kPa; 0 in a free direction."""
        blocks = [self._block(block)[0] for block in self.forward.blocks]
        return {f"stress_{axis}": self._joined([b[axis] for b in blocks]) for axis in "xy"}

    def sum_of_squares(self) -> TensorVariable | None:
        """Sum of the squared differences from measured stresses, by a table; None without one."""
        table = self.forward.table
        if table is None:
            return None
        inputs = self.forward.share("misfits", table.arrays)
        return table.sum_of_squares(inputs, self.parameters)

    def slopes(self) -> dict[tuple[str, str], TensorVariable]:
        """Derivatives of the stresses by the measured stretches, by the axes of both, kPa.

        In a free direction they are 0; the stretch of that direction follows the other one.
        """
        found: dict[tuple[str, str], list] = {(a, b): [] for a in "xy" for b in "xy"}
        for block in self.forward.blocks:
            stresses, logs = self._block(block)
            for (axis, by), slopes in found.items():
                slope = pt.zeros_like(stresses[axis])
                if by in logs:
                    slope = elementwise_derivative(stresses[axis], logs[by]) * pt.exp(-logs[by])
                slopes.append(slope)
        return {axes: self._joined(slopes) for axes, slopes in found.items()}

    @property
    def _inputs(self) -> dict[str, Any]:
        return self.forward.share("stretches", self.forward.arrays)

    def _block(self, block: str) -> tuple[dict[str, TensorVariable], dict[str, TensorVariable]]:
        """Return the stresses of a block, and the logarithms of its measured stretches."""
        inputs, energy = self._inputs, self.forward.energy
        entries = energy.split(self.parameters)
        if self.forward.by_test:
            test = inputs[f"{block}_test"]
            entries = [entry[test] if is_inferred(entry) else entry for entry in entries]
        # Expressions of their own, by which stresses are differentiated.
        logs = {axis: inputs.get(f"{block}_{axis}") for axis in "xy"}
        known = {axis: pt.as_tensor(log) + 0.0 for axis, log in logs.items() if log is not None}
        true = {axis: self._true_stretch(block, log) for axis, log in known.items()}
        x, y, log_x, log_y = stresses_at(energy, true.get("x"), true.get("y"), entries)
        if (factor := self._factor("sheet_thickness", block)) is not None:
            x, y = x * factor, y * factor
        # A measured Cauchy stress is the nominal stress times the measured stretch. In a free
        # direction both stresses are 0.
        by_stretch = 1 - inputs[f"{block}_nominal"]
        stresses = {
            axis: cauchy * pt.exp(by_stretch * known.get(axis, log) - log)
            for axis, cauchy, log in (("x", x, log_x), ("y", y, log_y))
        }
        return stresses, known

    def _true_stretch(self, block: str, log_stretch: TensorVariable) -> TensorVariable:
        """Return the logarithm of the true stretch: the gauge length may have an error."""
        factor = self._factor("gauge_length", block)
        return log_stretch if factor is None else pt.log1p(pt.expm1(log_stretch) / factor)

    def _factor(self, name: str, block: str) -> TensorVariable | None:
        """Return the true measure over the measured one at the points of a block."""
        if name not in self.deviations:
            return None
        of_points = self.deviations[name][self._inputs[f"{block}_test"]]
        return pt.exp(self.forward.sds[name] * of_points)

    def _joined(self, blocks: list[TensorVariable]) -> TensorVariable:
        """Values of all blocks, in the order of the points."""
        if len(blocks) == 1:
            return blocks[0]
        return pt.concatenate(blocks, axis=-1)[self._inputs["place"]]


def _rows_of_blocks(data: xr.Dataset) -> dict[str, Points]:
    """Return the points of each block."""
    known = [np.isfinite(data[f"stretch_{axis}"].values.astype(float)) for axis in "xy"]
    return {
        name: np.flatnonzero((known[0] == x) & (known[1] == y)) for name, (x, y) in _BLOCKS.items()
    }
