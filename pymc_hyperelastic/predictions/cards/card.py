"""Cards for finite-element codes: the function that people call."""

from collections.abc import Sequence
from importlib.metadata import version
from numbers import Real

import numpy as np
import xarray as xr

from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.settings import NamedLayer
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.cards.abaqus import ABAQUS
from pymc_hyperelastic.predictions.cards.febio import FEBIO
from pymc_hyperelastic.predictions.cards.materials import (
    UNITS,
    Code,
    Material,
    Units,
    bulk_modulus_of,
    in_units,
)
from pymc_hyperelastic.predictions.cards.points import Point, PointOfWall, point_of, thinned
from pymc_hyperelastic.predictions.members import TYPICAL
from pymc_hyperelastic.predictions.walls import WallDraws, wall_draws_of

_CODES = {"febio": FEBIO, "abaqus": ABAQUS}

_INCOMPRESSIBLE = (
    "The package's wall keeps its volume. Here it nearly does, with a bulk modulus of {bulk}: see "
    "that J stays near 1 in your model, and give a larger bulk_modulus where it does not. Elements "
    "must be made for such solids (FEBio: three-field hexahedra; Abaqus/Standard: hybrid ones)."
)
_RULE = "1000 times the stiffness at rest (the shear modulus, and 4 k1 of fibres) of each material"
_AXES = (
    "Fibres lie in the plane around and along the tube, at plus and minus beta from the "
    "circumferential direction. The axis of the tube is the global z axis through the origin: "
    "change the axes if yours is another."
)


@one_thread
def material_card(
    tree: xr.DataTree,
    code: str,
    *,
    specimen: str | None = None,
    energy: StrainEnergy | Sequence[Layer] | None = None,
    point: Point = "draw",
    draws: int = 0,
    unit: str = "kPa",
    bulk_modulus: float | None = None,
) -> str:
    r"""Posterior as materials of a finite-element code: text to be saved and included in a model.

    The card holds one material a layer, from the inside out: ``wall``, or ``layer_1``, ``layer_2``.
    Comments say of whom and of which draw it is, in which units, and which energy the code makes of
    its numbers. Further draws follow as ``wall_draw_1``, ``wall_draw_2``, for a study of what the
    posterior's uncertainty does to a model: only the name changes from run to run.

    The mean of draws of correlated parameters need not lie in their posterior: along a bent ridge
    of ``k1`` and ``k2`` it is a stiffer or softer material than any that fits the data. The default
    is therefore the draw nearest the mean.

    The package's walls are incompressible. Here ``W`` is that of a deformation without its change
    of volume, :math:`\bar F = J^{-1/3} F`, beside an energy of the volume with the bulk modulus
    ``K``,

    .. math:: W(\bar F) + U(J), \qquad U'(1) = 0, \quad U''(1) = K,

    so that at ``J = 1`` it is the package's. By default ``K`` is 1000 times the stiffness at rest:
    the shear modulus, to which fibres add ``4 k1``. That is large beside the stresses of most
    walls, and small enough that elements converge.

    ====================  ==========================  =================
    law                   FEBio                       Abaqus
    ====================  ==========================  =================
    NeoHookean            Mooney-Rivlin               NEO HOOKE, ccx
    MooneyRivlin          Mooney-Rivlin               MOONEY-RIVLIN, ccx
    Yeoh                  Yeoh                        YEOH, ccx
    ArrudaBoyce           uncoupled hyperelastic      ARRUDA-BOYCE, ccx
    Gent                  uncoupled hyperelastic      none
    Demiray               uncoupled hyperelastic      none
    PowerLawNeoHookean    uncoupled hyperelastic      none
    Ogden                 Ogden                       OGDEN, N=2, ccx
    OgdenSeries           Ogden, up to 6 terms        OGDEN, up to 6 terms, ccx
    HolzapfelGasserOgden  Holzapfel-Gasser-Ogden      HOLZAPFEL
    GasserOgdenHolzapfel  Holzapfel-Gasser-Ogden      HOLZAPFEL
    FourFiber             uncoupled solid mixture     none
    FungOrthotropic       none                        none
    CriscioneType         none                        none
    ====================  ==========================  =================

    CalculiX (ccx) reads the keyword lines that are marked, of Ogden's law up to 3 terms. Where
    ``D2`` and ``D3`` are 0 it puts numbers of its own, which matter at large changes of volume
    alone. The energies of ``FungOrthotropic`` and ``CriscioneType`` say nothing of radial strain
    and of shear, for which these codes need moduli.

    Conventions: the shear modulus of Ogden's law is ``Σ μi`` in Abaqus (``W = Σ 2 μi/αi² (...)``),
    ``½ Σ ci`` in FEBio (``W = Σ ci/mi² (...)``) and ``½ Σ μp αp`` in ``OgdenSeries``. Fibres are at
    ``±β`` from the circumferential direction and bear load where their mean strain ``E`` is
    positive, in both codes as here. They are stated by the local axes of a tube along the global
    ``z`` axis: FEBio's are 1 around and 2 along it (``gamma`` is ``β``), Abaqus' are 1 radial, 2
    around and 3 along; ``*SOLID SECTION, ORIENTATION=wall_axes`` makes Abaqus use them.

    Source: FEBio User's Manual 4, chapter Materials, and for "uncoupled hyperelastic" the program's
    source; Abaqus Analysis User's Guide, "Hyperelastic behavior of rubberlike materials" and
    "Anisotropic hyperelastic behavior"; CalculiX CrunchiX User's Manual, ``*HYPERELASTIC``.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model: the result of :func:`sample_smc` or of PyMC's samplers, or a class of
        :func:`fit_classes`.
    code : {"febio", "abaqus"}
        For which code.
    specimen : str, optional
        Of classes and populations whose specimens differ, the one that is meant; the typical one
        when missing.
    energy : StrainEnergy or list of Layer, optional
        The material, or the layers, if the result does not name them.
    point : {"draw", "mean", "median"}
        The material that stands for the posterior: the draw nearest the mean, or the mean or the
        median of each parameter by itself. For the distance, each parameter is divided by its
        standard deviation; parameters that are positive, or whose sign makes no difference, are
        replaced by their logarithms. Draws whose distances differ by less than a millionth of a
        standard deviation are equally near, and the first of them is taken.
    draws : int, default 0
        Number of further materials, draws of the posterior at equal distances along its chains.
    unit : {"kPa", "MPa"}
        Unit of stress, and with it the system of units: mm, mN and kg, or mm, N and tonnes.
    bulk_modulus : float, optional
        ``K``, in `unit`, of all materials.

    Returns
    -------
    str
        For FEBio a file of its format 4.0 with a ``Material`` section, to be included by
        ``<Material from="..."/>``; numbers read back exactly. For Abaqus keyword lines, to be
        included by ``*INCLUDE, INPUT=...``; its fields have 20 characters, which hold 17 digits of
        numbers above 0.01 and at least 14 of smaller ones. Both are plain ASCII.

    Raises
    ------
    TypeError
        If `tree` is no DataTree, `energy` no strain energy, or `draws` no whole number.
    ValueError
        If `code`, `unit`, `point` or the specimen is unknown, there is no posterior or there are
        fewer draws, the code does not have the law, or not with these numbers.

    See Also
    --------
    wall_stress : The same stresses without finite elements, in a tube.

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, 25.0, 32.0]])})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> card = ph.material_card(tree, "abaqus", energy=ph.NeoHookean())
    >>> print("\n".join(line for line in card.splitlines() if line[:2] != "**"))
    *MATERIAL, NAME=wall
    *HYPERELASTIC, NEO HOOKE
    12.5, 8.0E-05
    """
    made_for, units = _known("code", code, _CODES), _known("unit", unit, UNITS)
    if bulk_modulus is not None and not (
        isinstance(bulk_modulus, Real) and 0 < bulk_modulus < np.inf
    ):
        raise ValueError(f"bulk_modulus must be a positive number in {unit}; got {bulk_modulus!r}")
    of_wall = wall_draws_of(tree, energy, specimen)
    for layer in of_wall.wall:
        _check_law(layer.energy, made_for)
    points = [point_of(of_wall, point), *thinned(of_wall, draws)]
    materials = [
        _material(of_wall, place, at, units, bulk_modulus)
        for at in points
        for place in range(len(of_wall.wall))
    ]
    bulk = _RULE if bulk_modulus is None else f"{bulk_modulus:g} {unit}"
    header = [
        f"Written by pymc_hyperelastic {version('pymc-hyperelastic')} for {made_for.label}.",
        _whose(tree, of_wall),
        f"Units: {units.words}.",
        f"Without a number in its name: {points[0].words}.",
        *_of_draws(len(points) - 1, of_wall),
        *dict.fromkeys(_what_it_means(layer, made_for) for layer in of_wall.wall),
        _INCOMPRESSIBLE.format(bulk=bulk),
    ]
    if any("beta" in layer.energy.parameter_names for layer in of_wall.wall):
        header.append(_AXES)
    return made_for.write(header, materials)


def _known[T](name: str, value: str, known: dict[str, T]) -> T:
    if not isinstance(value, str) or value not in known:
        raise ValueError(f"{name} is {value!r}; expected one of {list(known)}")
    return known[value]


def _check_law(energy: StrainEnergy, code: Code) -> None:
    """Raise ValueError unless the code has the law."""
    law = type(energy)
    if law in code.laws:
        return
    others = [other.label for other in _CODES.values() if law in other.laws]
    reason, known = code.reasons.get(law), ", ".join(has.__name__ for has in code.laws)
    raise ValueError(
        f"{energy.name} has no card for {code.label}"
        + (f": {reason}" if reason else "")
        + f". {code.label} has {known}; {energy.name} has "
        + (f"a card for {', '.join(others)}" if others else "none for any code")
    )


def _material(
    of_wall: WallDraws, place: int, at: PointOfWall, units: Units, given: float | None
) -> Material:
    """A layer of the wall at a point of the posterior."""
    energy, count = of_wall.wall[place].energy, len(of_wall.wall)
    values = in_units(energy, at.values[place], units)
    name = "wall" if count == 1 else f"layer_{place + 1}"
    listed = []
    for p in energy.parameters:
        unit = units.stress if p.unit == "kPa" else p.unit
        listed.append(f"{p.name} = {values[p.name]!r} {unit}".rstrip())
    notes = f"{name}{at.suffix}: {energy!r}, {', '.join(listed)}"
    if at.suffix:
        notes += f"; {at.words}"
    if "thickness" in at.values[place]:
        thickness = float(at.values[place]["thickness"])
        notes += f"; layer {place + 1} of {count} from the inside, {thickness!r} mm thick at rest"
    bulk = bulk_modulus_of(energy, values, given)
    return Material(name + at.suffix, energy, values, bulk, [notes])


def _whose(tree: xr.DataTree, of_wall: WallDraws) -> str:
    """Of whom the posterior is, and from which data. What users name is written in ASCII."""
    name = of_wall.member.name
    if name is None:
        words = "Posterior of the material"
    elif name == TYPICAL:
        words = "Posterior of the typical specimen"
    else:
        words = f"Posterior of specimen {name!a}"
    if tree.name:
        words += f", class {tree.name!a}"
    attrs = {} if of_wall.member.data is None else of_wall.member.data.attrs
    title = f", from {attrs['title']!a}" if attrs.get("title") else ""
    return words + title + (" (simulated data)." if attrs.get("simulated") else ".")


def _of_draws(count: int, of_wall: WallDraws) -> list[str]:
    if not count:
        return []
    sizes = of_wall.member.posterior.sizes
    return [
        f"With a number in its name: {count} of the {sizes['chain'] * sizes['draw']} draws of the "
        "posterior, at equal distances along its chains."
    ]


def _what_it_means(layer: NamedLayer, code: Code) -> str:
    return f"{layer.energy.name}: {code.laws[type(layer.energy)].formula}."
