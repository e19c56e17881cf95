"""Predict the stresses of a sheet, as posteriors, from any sampled result."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.sheets import sheets_of, tubes_of
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.mechanics.strain_energy.base import IsotropicStrainEnergy
from pymc_hyperelastic.models.forward import numeric_stresses
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.draws import labelled, medians_of_measures
from pymc_hyperelastic.predictions.measured import (
    Extrapolated,
    ends_in_words,
    measured_by,
    typical_tests,
    upper_hull,
    warn_user,
    warned,
)
from pymc_hyperelastic.predictions.members import Member
from pymc_hyperelastic.predictions.walls import values_by_draw, wall_draws_of
from pymc_hyperelastic.quantities import IN_RESULTS, SHEET_MEASURES
from pymc_hyperelastic.rounding import DIGITS

Array = NDArray[np.float64]


@one_thread
def predict_stress(
    result: xr.DataTree,
    stretch_x: Any,
    stretch_y: Any = None,
    *,
    nominal: bool = False,
    specimen: str | None = None,
    energy: StrainEnergy | None = None,
) -> xr.Dataset:
    """Predict the stresses of a sheet at new stretches, without measurement error.

    The sheet is that of :func:`~pymc_hyperelastic.sheet_stress`, which lists the stretches of the
    usual tests. The result may be one of sheets or of tubes: a strip of a vessel, of which
    inflation tests are known, is pulled along x in the hoop direction, and along y in the axial
    direction.

    Parameters
    ----------
    result : xarray.DataTree
        A sampled model, see :func:`predict_pressure`.
    stretch_x, stretch_y : array_like, shape (point,), or None
        Stretches along the axes: deformed length over unloaded length. A number stands for all
        points. None, or NaN at some points, stands for a direction in which the sheet is free.
    nominal : bool, default False
        If True, return nominal stresses (force per area of the unloaded cross-section) in place of
        Cauchy stresses.
    specimen : str, optional
        Name of the specimen to predict, see the notes of :func:`predict_pressure`: without a name
        it is the typical one, if the specimens of a class differ.
    energy : StrainEnergy, optional
        The strain energy of the model; required if the result does not name it.

    Returns
    -------
    xarray.Dataset
        ``stress_x`` and ``stress_y`` (kPa) with dimensions (chain, draw, point); 0 in a free
        direction, and NaN for draws that have no lateral stretch at which the free direction has no
        stress. The coordinates ``stretch_x`` and ``stretch_y`` have the dimension ``point``; if the
        sheet is free along this axis at some points, they have (chain, draw, point), because the
        lateral stretch follows from the material. The attribute ``stress_measure`` is ``"cauchy"``
        or ``"nominal"``.

        The coordinate ``extrapolated`` (point) is True if the stretches lie outside the convex hull
        of the stretches in the result's data, on logarithmic axes. The unloaded sheet, and the hoop
        and axial stretches of tubes, are in this hull. A sheet that is pulled along one axis only
        is not extrapolated up to the largest stretch of such a test. The coordinate is absent if
        the result does not hold its data.

    Warns
    -----
    UserWarning
        If a point is extrapolated. If some draws have no lateral stretch.

    Raises
    ------
    TypeError
        If `result` is no DataTree, `energy` no strain energy, or both stretches are None.
    ValueError
        If the strain energy or the specimen is unknown, a parameter is missing from the posterior,
        a stretch is not positive, both stretches of a point are NaN, or the result is of a wall of
        layers.

    See Also
    --------
    sheet_stress, predict_pressure, sheet_data

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, 30.0]])})
    >>> result = xr.DataTree.from_dict({"posterior": posterior})
    >>> strip = ph.predict_stress(result, [1.0, 1.5], energy=ph.NeoHookean())
    >>> strip["stress_x"].values.round(3)
    array([[[ 0.   , 31.667],
            [ 0.   , 47.5  ]]])
    >>> strip["stretch_y"].values.round(3)  # free: 1/√λx
    array([[[1.   , 0.816],
            [1.   , 0.816]]])

    A strip along the axis of a vessel, from a result of its inflation tests:

    >>> tree = ph.open_result("sampled.nc")  # saved from the example of sample_smc
    >>> strip = ph.predict_stress(tree, 1.0, [1.0, 1.05, 1.1])
    >>> strip["stress_y"].dims
    ('chain', 'draw', 'point')
    """
    stretches = _checked_stretches(stretch_x, stretch_y)
    draws = sheet_draws_of(result, specimen, energy)
    found = _stresses(draws, stretches, nominal)
    _warn_of_no_lateral_stretch(found, stretches)
    extrapolated = warned(draws.extrapolated(stretches))
    if extrapolated is not None:
        found = found.assign_coords(
            extrapolated=("point", extrapolated.points, IN_RESULTS["extrapolated"].attributes)
        )
    found.attrs["stress_measure"] = "nominal" if nominal else "cauchy"
    return found


class SheetDraws(NamedTuple):
    """Material of each draw of a posterior."""

    energy: StrainEnergy
    entries: list[Array]
    """Entries of the parameters, which broadcast to (chain, draw, 1)."""
    member: Member
    """Specimen whose parameters and tests are used."""
    of_class: str | None = None
    """Name of the class, if the result is one of several classes."""
    ratios: Mapping[str, Array] = MappingProxyType({})
    """True over measured measures of the sheet, by name, (chain, draw, 1); none if known."""

    def extrapolated(self, stretches: Mapping[str, Array]) -> Extrapolated | None:
        """Flag points outside the measured stretches; None if the result has no data."""
        evidence = self.member.evidence
        tests = None if evidence is None else self._measured(evidence)
        if tests is None:
            return None
        asked = self._log_stretches(stretches)
        beyond = _beyond_hull(asked, tests.logs)
        for axis, other in ("xy", "yx"):
            # Between two measured points the curve of a free stretch may leave the hull.
            largest = tests.pulled_alone[axis]
            here = np.isnan(stretches[other]) & _between(asked[axis], *largest)
            beyond &= ~here
        words = ", ".join(
            f"stretch along {axis} {ends_in_words(np.exp(asked[axis][beyond]))}, measured "
            f"{ends_in_words(np.exp(tests.logs[axis]))}"
            for axis in "xy"
        )
        return Extrapolated(beyond, words, self.of_class)

    def _measured(self, data: xr.Dataset) -> "_Measured | None":
        """Return the stretches of the tests; None if no tube of the data is known."""
        logs = {axis: np.zeros(1) for axis in "xy"}  # the unloaded sheet
        alone = dict(logs)
        sheets, tubes = sheets_of(data), tubes_of(data)
        if sheets is not None:
            stretches = {axis: sheets[f"stretch_{axis}"].values.astype(float) for axis in "xy"}
            for axis, found in self._log_stretches(stretches).items():
                free = np.isnan(stretches["y" if axis == "x" else "x"])
                logs[axis] = np.append(logs[axis], found)
                alone[axis] = np.append(alone[axis], found[free])
        if tubes is not None:
            medians = medians_of_measures(self.member.posterior)
            walls = measured_by(typical_tests(tubes, medians))
            if walls is None and sheets is None:
                return None
            if walls is not None:
                hoop = np.log(walls.hoop_stretches())
                axial = np.broadcast_to(np.log(walls.tubes["axial_stretch"]), hoop.shape)
                logs = {"x": np.append(logs["x"], hoop), "y": np.append(logs["y"], axial)}
        if isinstance(self.energy, IsotropicStrainEnergy):
            # The same material stands along both axes.
            logs = {"x": np.append(logs["x"], logs["y"]), "y": np.append(logs["y"], logs["x"])}
            alone = dict.fromkeys("xy", np.append(alone["x"], alone["y"]))
        return _Measured(logs, {axis: (v.min(), v.max()) for axis, v in alone.items()})

    def _log_stretches(self, stretches: Mapping[str, Array]) -> dict[str, Array]:
        """Return logarithms of stretches; a free one is the median over the draws that have it."""
        logs = {axis: np.log(values) for axis, values in stretches.items()}
        for axis in "xy":
            free = np.isnan(stretches[axis])
            if free.any():
                points = {name: values[free] for name, values in stretches.items()}
                lateral = self.stresses(points)[f"log_{axis}"]
                logs[axis][free] = pd.DataFrame(lateral.reshape(-1, free.sum())).median()
        return logs

    def measured(
        self, stretches: Mapping[str, Array], nominal: NDArray[np.bool_]
    ) -> dict[str, Array]:
        """Return stresses as they were measured, at measured stretches, (chain, draw, point).

        The thickness and the gauge length by which they were computed may have had errors.
        """
        length = self.ratios.get("gauge_length", np.ones((1, 1, 1)))
        found = self.stresses({axis: 1 + (v - 1) / length for axis, v in stretches.items()})
        thickness, measured = self.ratios.get("sheet_thickness", 1.0), {}
        for axis, stretch in stretches.items():
            true = np.exp(found[f"log_{axis}"])
            # A measured Cauchy stress is the nominal stress times the measured stretch.
            factor = np.where(nominal, 1.0, np.where(np.isnan(stretch), true, stretch))
            measured[axis] = thickness * found[axis] / true * factor
        return measured

    def stresses(self, stretches: Mapping[str, Array]) -> dict[str, Array]:
        """Return Cauchy stresses, and logarithms of stretches, (chain, draw, point).

        The stretches are (point) or, if they differ between draws, (chain, draw, point).
        """
        logs = {axis: np.log(np.array(v, ndmin=3)) for axis, v in stretches.items()}
        shapes = [np.shape(values) for values in (*logs.values(), *self.entries)]
        shape = np.broadcast_shapes(*shapes)
        found = {name: np.full(shape, np.nan) for name in ("x", "y", "log_x", "log_y")}
        free = {axis: np.isnan(log[0, 0]) for axis, log in logs.items()}
        for given in ((True, True), (True, False), (False, True)):
            here = (free["x"] != given[0]) & (free["y"] != given[1])
            if here.any():
                log_x, log_y = (
                    logs[axis][..., here] if known else None
                    for axis, known in zip("xy", given, strict=True)
                )
                values = numeric_stresses(self.energy, log_x, log_y, self.entries)
                for name, value in zip(found, values, strict=True):
                    found[name][..., here] = value
        return found


class _Measured(NamedTuple):
    """Logarithms of the stretches along both axes of the measured points."""

    logs: dict[str, Array]
    pulled_alone: dict[str, tuple[float, float]]
    """Ends of the range along each axis in tests that were free along the other one."""


def sheet_draws_of(
    result: xr.DataTree, specimen: str | None = None, energy: StrainEnergy | None = None
) -> SheetDraws:
    """Return the material of each draw.

    Raises
    ------
    ValueError
        If the wall of the result has layers.
    """
    wall, member, values = wall_draws_of(result, energy, specimen)
    if "thickness" in wall[0].values:
        raise ValueError(
            "the result is of a wall of layers, and a sheet is of one material: predict tubes of "
            "these layers, such as ph.predict_pressure, or fit one strain energy"
        )
    law, posterior = wall[0].energy, member.posterior
    ratios = {n: values_by_draw(posterior, n) for n in SHEET_MEASURES if n in posterior}
    return SheetDraws(law, law.split(values[0]), member, result.name, ratios)


def _stresses(draws: SheetDraws, stretches: Mapping[str, Array], nominal: bool) -> xr.Dataset:
    """Return what :func:`predict_stress` returns, without a warning and extrapolated points."""
    found = draws.stresses(stretches)
    dims = ("chain", "draw", "point")
    posterior = draws.member.posterior
    coords: dict[str, Any] = {name: posterior[name] for name in ("chain", "draw")}
    variables: dict[str, Any] = {}
    for axis in "xy":
        given, lateral = stretches[axis], np.exp(found[f"log_{axis}"])
        is_free = np.isnan(given)
        # Given stretches are not changed by a logarithm.
        coords[f"stretch_{axis}"] = (
            (dims, np.where(is_free, lateral, given)) if is_free.any() else ("point", given)
        )
        variables[f"stress_{axis}"] = (dims, found[axis] / lateral if nominal else found[axis])
    return labelled(xr.Dataset(variables, coords), draws.member)


def _checked_stretches(stretch_x: Any, stretch_y: Any) -> dict[str, Array]:
    """Return stretches along both axes as arrays of one length, NaN where free; else raise."""
    if stretch_x is None and stretch_y is None:
        raise TypeError(
            "both stretches are None: give stretch_x, stretch_y or both; None stands for a "
            "direction in which the sheet is free"
        )
    arrays = {}
    for name, given in (("stretch_x", stretch_x), ("stretch_y", stretch_y)):
        try:
            values = np.atleast_1d(np.asarray(np.nan if given is None else given, float))
        except (TypeError, ValueError):
            values = np.array([])
        if values.ndim != 1 or not values.size or not np.all(np.isnan(values) | (values > 0)):
            raise ValueError(
                f"{name} must be a list of positive stretches, or NaN where the sheet is free; got "
                f"{given!r}"
            )
        if np.isinf(values).any():
            raise ValueError(f"{name} must be finite; got {given!r}")
        arrays[name] = values
    sizes = {name: values.size for name, values in arrays.items()}
    if len({*sizes.values()} - {1}) > 1:
        raise ValueError(
            f"there are {sizes['stretch_x']} stretches along x and {sizes['stretch_y']} along y: "
            "expected one stretch, or one for each point"
        )
    x, y = np.broadcast_arrays(*arrays.values())
    if (neither := np.flatnonzero(np.isnan(x) & np.isnan(y))).size:
        raise ValueError(
            f"both stretches of point {neither[0]} are NaN: a sheet is free along one axis at most"
        )
    return {"x": x.copy(), "y": y.copy()}


def _warn_of_no_lateral_stretch(found: xr.Dataset, stretches: Mapping[str, Array]) -> None:
    """Warn if some draws have no lateral stretch at some points."""
    missing = np.isnan(found["stretch_x"]) | np.isnan(found["stretch_y"])
    if not missing.any():
        return
    missing = missing.transpose("chain", "draw", "point").values
    count, points = int(missing.any(axis=-1).sum()), missing.any(axis=(0, 1))
    pulled = np.where(np.isnan(stretches["x"]), stretches["y"], stretches["x"])
    warn_user(
        f"of {missing[..., 0].size} draws {count} have no lateral stretch without lateral stress "
        f"at stretch {ends_in_words(pulled[points])}; the values are NaN there"
    )


def _beyond_hull(asked: Mapping[str, Array], measured: Mapping[str, Array]) -> NDArray[np.bool_]:
    """Flag points outside the convex hull of the measured ones; NaN are outside."""
    known = np.isfinite(measured["x"]) & np.isfinite(measured["y"])
    x, y = measured["x"][known], measured["y"][known]
    low = -upper_hull(asked["x"], x, -y)
    high = upper_hull(asked["x"], x, y)
    within = _between(asked["x"], x.min(), x.max()) & _between(asked["y"], low, high)
    return ~within


def _between(x: Array, low: Any, high: Any) -> NDArray[np.bool_]:
    """Return True for logarithms of stretches in a range, up to rounding errors."""
    margin = 10.0**-DIGITS
    return np.asarray((x >= low - margin) & (x <= high + margin))
