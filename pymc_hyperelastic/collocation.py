"""The pressure integral as a constant matrix, for known radii and geometry.

Pressure and stiffness are linear in the material's response ``T(ln λθ)``. Where radii and geometry
are known, they are ``M g`` and ``S g``: ``g`` holds the response at ``K`` Chebyshev stretches that
span the walls, and the matrices do not depend on the material. The squared misfit to any number
of points is then, by a QR factorisation, that of ``K`` numbers.
"""

from functools import cache
from typing import Any

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from pytensor.graph.basic import Apply, Variable
from pytensor.graph.replace import _vectorize_node
from pytensor.graph.utils import MissingInputError
from pytensor.tensor.blockwise import vectorize_node_fallback
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data import GEOMETRY
from pymc_hyperelastic.pressure import TubeOp, wall_rule
from pymc_hyperelastic.strain_energy.base import StrainEnergy
from pymc_hyperelastic.tube import stretches

__all__ = [
    "CollocatedPressureIntegral",
    "chebyshev_nodes",
    "collocate",
    "curve_matrices",
    "nodes_needed",
    "value_to_coefficient",
]

Array = NDArray[np.float64]

# Chebyshev coefficients of the response below this fraction of the largest are left out. The
# pressure is then right to about 1e-12 of the largest in the data, and rounding is not mistaken
# for signal.
_COEFFICIENT_TOLERANCE = 1e-14
_MOST_NODES = 64
# Points whose walls are handled at once: bounds memory, whatever the size of the data.
_CHUNK = 2048


class CollocatedPressureIntegral(TubeOp):
    r"""Pressures and stiffnesses of known tubes as constant matrices times the wall's response.

    .. math:: T_{gk} = T(\ln λ_θ^{(gk)}, \ln λ_z^{(g)}), \qquad
        p_{gj} = \sum_k M_{gjk} T_{gk}, \qquad s_{gj} = \sum_k S_{gjk} T_{gk}

    Inputs are ``ln λθ`` at the nodes (group, node), ``ln λz`` (group), ``M`` and ``S`` (group, row,
    node), then the parameters, scalars in the order of the strain energy. Tests of one axial
    stretch form a group. Outputs are the two products, (group, row).

    Attributes
    ----------
    strain_energy : StrainEnergy
        The material.
    """

    __props__ = ("strain_energy",)

    def build_inner_graph(self, *inputs: TensorVariable) -> list[Variable]:
        """Response at the nodes, then one matrix product a group."""
        log_hoop, log_axial, *matrices = inputs[:4]
        parameters = inputs[4:]
        batched = any(x.type.ndim for x in parameters)
        log_axial = log_axial[:, None]
        if batched:
            # The particles run along the last axis, where NumPy sums over the others are fast.
            log_hoop, log_axial = log_hoop[..., None], log_axial[..., None]
        log_hoop, log_axial, *parameters = pt.broadcast_arrays(log_hoop, log_axial, *parameters)
        response = self.response(log_hoop, log_axial, parameters)
        if batched:
            return [pt.moveaxis(matrix @ response, -1, 0) for matrix in matrices]
        return [(matrix @ response[..., None])[..., 0] for matrix in matrices]


@_vectorize_node.register(CollocatedPressureIntegral)
def _vectorize_collocated(
    op: CollocatedPressureIntegral, node: Apply, *inputs: TensorVariable
) -> Apply:
    """Take a batch of parameters in one call; anything else is looped over."""
    parameters = inputs[4:]
    if inputs[:4] != tuple(node.inputs[:4]) or any(x.type.ndim > 1 for x in parameters):
        return vectorize_node_fallback(op, node, *inputs)
    parameters = pt.broadcast_arrays(*(pt.atleast_1d(x) for x in parameters))
    return CollocatedPressureIntegral(strain_energy=op.strain_energy)(*inputs[:4], *parameters)[
        0
    ].owner


def nodes_needed(
    energy: StrainEnergy, data: xr.Dataset, parameters: dict[str, TensorVariable]
) -> int | None:
    """Number ``K`` of Chebyshev stretches at which the response must be known, or None.

    The response is expanded at the corners of the parameters' range and at random draws from it;
    ``K`` is where the coefficients have fallen below rounding for all of them. None means that more
    than 64 were needed or the parameters cannot be drawn: then the direct rule is to be used.
    """
    values = _representative_values([parameters[name] for name in energy.parameter_names])
    if values is None:
        return None
    node = chebyshev_nodes(2 * _MOST_NODES)
    needed = 2
    for axial_stretch, _, (centre, half) in _groups(data):
        shape = (-1, 1)
        with np.errstate(all="ignore"):
            response = _response_function(energy)(
                (centre + half * node)[None, :],
                np.full((1, 1), np.log(axial_stretch)),
                *(v.reshape(shape) for v in values),
            )
        response = response[np.isfinite(response).all(axis=1)]
        coefficients = np.abs(response @ value_to_coefficient(node.size).T)
        largest = coefficients.max(axis=1, keepdims=True)
        significant = np.flatnonzero((coefficients > _COEFFICIENT_TOLERANCE * largest).any(axis=0))
        needed = max(needed, int(significant.max(initial=0)) + 1)
    return needed if needed <= _MOST_NODES else None


def collocate(
    data: xr.Dataset, count: int, interior: NDArray[np.intp], slope: Array
) -> dict[str, Any]:
    """Matrices of :class:`CollocatedPressureIntegral`, compressed against the measured values.

    With a QR factorisation ``[M y] = Q [R c; 0 ρ]`` of a group, ``|M g − y|² = |R g − c|² + ρ²``
    for every response ``g``. Pressures (all points) and slopes (interior points) are compressed
    separately, so that their weights may be unknown.

    Parameters
    ----------
    data : xarray.Dataset
        Inflation data.
    count : int
        Number of Chebyshev stretches.
    interior : array of int
        Points at which slopes are compared.
    slope : array
        Measured slope at each of them, kPa/mm.

    Returns
    -------
    dict of str to array
        ``log_hoop`` (group, node), ``log_axial`` (group), and for ``pressure`` and ``slope`` the
        ``_matrix`` (group, node, node), ``_target`` (group, node) and ``_residual`` (the sum of
        all ``ρ²``).
    """
    node = chebyshev_nodes(count)
    target = {"pressure": data["pressure"].values, "slope": np.full(data.sizes["obs"], np.nan)}
    target["slope"][interior] = slope
    hoop, axial = [], []
    factors: dict[str, list[Array]] = {"pressure": [], "slope": []}
    residual = {"pressure": 0.0, "slope": 0.0}
    for axial_stretch, points, (centre, half) in _groups(data):
        hoop.append(centre + half * node)
        axial.append(np.log(axial_stretch))
        augmented = {name: np.zeros((count + 1, count + 1)) for name in factors}
        for start in range(0, len(points), _CHUNK):
            chunk = points[start : start + _CHUNK]
            matrices = _matrices(data, chunk, centre, half, count)
            for name, matrix in zip(factors, matrices, strict=True):
                rows = np.column_stack([matrix, target[name][chunk]])
                rows = rows[~np.isnan(rows[:, -1])]
                stacked = np.concatenate([augmented[name], rows])
                augmented[name] = np.linalg.qr(stacked, mode="r")
        for name, triangle in augmented.items():
            factors[name].append(triangle[:-1])
            residual[name] += triangle[-1, -1] ** 2
    collocated: dict[str, Any] = {"log_hoop": np.array(hoop), "log_axial": np.array(axial)}
    for name, triangles in factors.items():
        stacked = np.array(triangles)
        collocated[f"{name}_matrix"] = stacked[..., :-1]
        collocated[f"{name}_target"] = stacked[..., -1]
        collocated[f"{name}_residual"] = np.array(residual[name])
    return collocated


def curve_matrices(data: xr.Dataset, count: int) -> tuple[dict[str, Array], NDArray[np.intp]]:
    """Matrices of :class:`CollocatedPressureIntegral` for the points themselves, uncompressed.

    Groups are padded to the same number of rows. With the matrices come the places of the points
    among all rows, group by group.
    """
    groups = _groups(data)
    node = chebyshev_nodes(count)
    most = max(len(points) for _, points, _ in groups)
    matrices = np.zeros((2, len(groups), most, count))
    place = np.zeros(data.sizes["obs"], int)
    for group, (_, points, (centre, half)) in enumerate(groups):
        place[points] = group * most + np.arange(len(points))
        for start in range(0, len(points), _CHUNK):
            chunk = points[start : start + _CHUNK]
            rows = slice(start, start + len(chunk))
            matrices[:, group, rows] = _matrices(data, chunk, centre, half, count)
    return {
        "log_hoop": np.array([centre + half * node for *_, (centre, half) in groups]),
        "log_axial": np.array([np.log(axial_stretch) for axial_stretch, *_ in groups]),
        "pressure_matrix": matrices[0],
        "slope_matrix": matrices[1],
    }, place


def _matrices(
    data: xr.Dataset, points: NDArray[np.intp], centre: float, half: float, count: int
) -> tuple[Array, Array]:
    """``M`` and ``S`` for the given points: (point, node) each."""
    wall = wall_rule(np, *_walls(data, points))
    vandermonde = chebyshev.chebvander((wall.log_hoop - centre) / half, count - 1)
    coefficient = value_to_coefficient(count)
    derivative = chebyshev.chebder(coefficient, axis=0) / half
    pressure = np.einsum("nq,nqk->nk", wall.pressure_weight, vandermonde) @ coefficient
    weighted = np.einsum("nq,nqk->nk", wall.stiffness_weight, vandermonde)
    return pressure, weighted[:, :-1] @ derivative / 2 - weighted @ coefficient


def _groups(data: xr.Dataset) -> list[tuple[float, NDArray[np.intp], tuple[float, float]]]:
    """Axial stretch, points, and the centre and half width of ``ln λθ``, of each group."""
    test = data["test"].values
    axial_stretch = data["axial_stretch"].values[test]
    groups = []
    for value in np.unique(axial_stretch):
        points = np.flatnonzero(axial_stretch == value)
        # Along a wall the stretch is monotonic: its two faces bound it.
        radius, inner, outer, axial, angle = _walls(data, points)
        tube = {"inner_radius": inner, "axial_stretch": axial, "opening_angle": angle}
        faces = [np.log(stretches(face, radius, **tube)[1]) for face in (inner, outer)]
        low, high = np.min(faces), np.max(faces)
        half = max((high - low) / 2, 1e-3)
        groups.append((float(value), points, ((low + high) / 2, half)))
    return groups


def _walls(data: xr.Dataset, points: NDArray[np.intp]) -> list[Array]:
    """Internal radius and geometry at the given points, each (point, 1)."""
    test = data["test"].values[points]
    geometry = [data[name].values[test] for name in GEOMETRY]
    return [values[:, None].astype(float) for values in (data["radius"].values[points], *geometry)]


def _representative_values(parameters: list[TensorVariable]) -> list[Array] | None:
    """Draws of the parameters, and the corners of the box that holds them."""
    try:
        draws = pm.draw(parameters, draws=256, random_seed=1, mode="FAST_COMPILE")
    except (MissingInputError, NotImplementedError):
        # They depend on something that is not random, or on a distribution that cannot be drawn
        # from, so that nothing is known of their range.
        return None
    ends = np.array([[d.min(), d.max()] for d in draws])
    corners = np.stack(np.meshgrid(*ends, indexing="ij")).reshape(len(draws), -1)
    return [np.concatenate([d, c]) for d, c in zip(draws, corners, strict=True)]


@cache
def _response_function(energy: StrainEnergy) -> Any:
    """Response at ``ln λθ`` (1, node) and ``ln λz`` (1, 1), for parameters (draw, 1)."""
    log_hoop = pt.tensor("log_hoop", dtype="float64", shape=(1, None))
    log_axial = pt.tensor("log_axial", dtype="float64", shape=(1, 1))
    parameters = {
        name: pt.tensor(name, dtype="float64", shape=(None, 1)) for name in energy.parameter_names
    }
    full = pt.broadcast_arrays(log_hoop, log_axial, *parameters.values())
    response = energy.stress_difference(
        full[0], full[1], **dict(zip(parameters, full[2:], strict=True))
    )
    inputs = [log_hoop, log_axial, *parameters.values()]
    return pytensor.function(inputs, response, mode="FAST_COMPILE")


@cache
def chebyshev_nodes(count: int) -> Array:
    """Chebyshev points of the first kind in (-1, 1)."""
    return np.cos(np.pi * (np.arange(count) + 0.5) / count)


@cache
def value_to_coefficient(count: int) -> Array:
    """Matrix from values at the Chebyshev nodes to Chebyshev coefficients."""
    cosines = np.cos(np.pi / count * np.outer(np.arange(count), np.arange(count) + 0.5))
    cosines[0] /= 2
    return 2 / count * cosines
