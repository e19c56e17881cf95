"""Write a posterior as a material card: the public function of this folder."""

from collections.abc import Sequence
from importlib.metadata import version
from numbers import Real

import numpy as np
import xarray as xr

from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.cards.abaqus import ABAQUS
from pymc_hyperelastic.predictions.cards.febio import FEBIO
from pymc_hyperelastic.predictions.cards.materials import (
    UNITS,
    Code,
    Material,
    bulk_modulus_of,
    in_units,
)
from pymc_hyperelastic.predictions.cards.points import Point, PointOfWall, point_of, thinned
from pymc_hyperelastic.predictions.members import TYPICAL
from pymc_hyperelastic.predictions.walls import WallDraws, wall_draws_of

# Finite-element codes by the name that the user gives.
_CODES = {"febio": FEBIO, "abaqus": ABAQUS}

# Notes in the header of every card, of the default bulk modulus, and of cards with fibres.
_INCOMPRESSIBLE = (
    "The wall of the package is incompressible. This material is nearly incompressible, with a "
    "bulk modulus of {bulk}: check that J stays near 1 in your model, and give a larger "
    "bulk_modulus if it does not. Use elements for nearly incompressible solids (FEBio: "
    "three-field hexahedra; Abaqus/Standard: hybrid elements)."
)
_RULE = "1000 times the stiffness at rest (shear modulus, plus 4 k1 with fibres) of each material"
_AXES = (
    "Fibres lie in the circumferential-axial plane, at plus and minus beta from the "
    "circumferential direction. The axis of the tube is the global z axis through the origin: "
    "change the axes if the tube of your model has another axis."
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
    r"""Write a posterior as materials of a finite-element code, to be included in a model.

    The card has one material per layer, from the inside out: ``wall``, or ``layer_1``, ``layer_2``.
    Its comments state the specimen, the draw, the units, and the strain energy in the notation of
    the code. Further draws follow as ``wall_draw_1``, ``wall_draw_2``. Run the model with each of
    them to propagate the uncertainty of the posterior; only the name of the material changes.

    The mean of correlated parameters need not lie in the posterior. If ``k1`` and ``k2`` lie on a
    curved ridge, the mean can be stiffer or softer than every material that fits the data. The
    default is therefore the draw nearest the mean.

    The walls of the package are incompressible. In the card ``W`` depends on the isochoric
    deformation :math:`\bar F = J^{-1/3} F`, and a volumetric energy with the bulk modulus ``K`` is
    added,

    .. math:: W(\bar F) + U(J), \qquad U'(1) = 0, \quad U''(1) = K,

    so that the material equals the package's at ``J = 1``. By default ``K`` is 1000 times the
    stiffness at rest, which is the shear modulus, plus ``4 k1`` with fibres. This is large compared
    with the stresses in most walls, and small enough for elements to converge.

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

    CalculiX reads the keyword lines marked with ccx, with up to 3 terms of Ogden's law. It replaces
    ``D2 = 0`` and ``D3 = 0`` by its own values, which matter only for large changes of volume. The
    energies of ``FungOrthotropic`` and ``CriscioneType`` do not depend on radial strain and shear,
    for which these codes need moduli.

    Conventions: the shear modulus of Ogden's law is ``Σ μi`` in Abaqus (``W = Σ 2 μi/αi² (...)``),
    ``½ Σ ci`` in FEBio (``W = Σ ci/mi² (...)``) and ``½ Σ μp αp`` in ``OgdenSeries``. Both codes
    and the package have fibres at ``±β`` from the circumferential direction, which bear load where
    their mean strain ``E`` is positive. The card defines them by the local axes of a tube along the
    global ``z`` axis. In FEBio axis 1 is circumferential and axis 2 axial (``gamma`` is ``β``). In
    Abaqus axis 1 is radial, 2 circumferential and 3 axial; activate the axes by
    ``*SOLID SECTION, ORIENTATION=wall_axes``.

    Source: FEBio User's Manual 4, chapter Materials, and for "uncoupled hyperelastic" FEBio's
    source code; Abaqus Analysis User's Guide, "Hyperelastic behavior of rubberlike materials" and
    "Anisotropic hyperelastic behavior"; CalculiX CrunchiX User's Manual, ``*HYPERELASTIC``.

    Parameters
    ----------
    tree : xarray.DataTree
        A sampled model: the result of :func:`sample_smc` or of PyMC's samplers, or a class of
        :func:`fit_classes`.
    code : {"febio", "abaqus"}
        Finite-element code for which the card is written.
    specimen : str, optional
        Name of the specimen, in classes and populations whose specimens differ; by default the
        typical specimen.
    energy : StrainEnergy or list of Layer, optional
        The material, or the layers, if the result does not name them.
    point : {"draw", "mean", "median"}
        The material that represents the posterior: the draw nearest the mean, or the mean or the
        median of each parameter separately. For the distance, each parameter is divided by its
        standard deviation; parameters that are positive, or whose sign makes no difference, are
        replaced by their logarithms. If distances differ by less than a millionth of a standard
        deviation, the first of these draws is taken.
    draws : int, default 0
        Number of further materials: draws of the posterior, evenly spaced along its chains.
    unit : {"kPa", "MPa"}
        Unit of stress. It determines the system of units: mm, mN and kg, or mm, N and tonnes.
    bulk_modulus : float, optional
        ``K``, in `unit`, of all materials.

    Returns
    -------
    str
        For FEBio, a file of format 4.0 with a ``Material`` section, to be included by
        ``<Material from="..."/>``; numbers read back exactly. For Abaqus, keyword lines to be
        included by ``*INCLUDE, INPUT=...``; fields have 20 characters, which hold 17 digits of
        numbers above 0.01 and at least 14 of smaller ones. Both are plain ASCII.

    Raises
    ------
    TypeError
        If `tree` is no DataTree, `energy` no strain energy, or `draws` no whole number.
    ValueError
        If `code`, `unit`, `point` or the specimen is unknown, the posterior is missing or has fewer
        draws, the code does not have the law, or it does not accept these parameters.

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
    made_for, units = _one_of("code", code, _CODES), _one_of("unit", unit, UNITS)
    if bulk_modulus is not None and not (
        isinstance(bulk_modulus, Real) and 0 < bulk_modulus < np.inf
    ):
        raise ValueError(f"bulk_modulus must be a positive number in {unit}; got {bulk_modulus!r}")
    of_wall = wall_draws_of(tree, energy, specimen)
    for layer in of_wall.wall:
        _check_law(layer.energy, made_for)
    points = [point_of(of_wall, point), *thinned(of_wall, draws)]
    materials = [
        _material(of_wall, place, at, unit, bulk_modulus)
        for at in points
        for place in range(len(of_wall.wall))
    ]
    bulk = _RULE if bulk_modulus is None else f"{bulk_modulus:g} {unit}"
    header = [
        f"Written by pymc_hyperelastic {version('pymc-hyperelastic')} for {made_for.label}.",
        _source_note(tree, of_wall),
        f"Units: {units}.",
        f"Materials without _draw_ in their name: {points[0].words}.",
        *_draws_note(len(points) - 1, of_wall),
        *dict.fromkeys(
            f"{layer.energy.name}: {made_for.laws[type(layer.energy)].formula}."
            for layer in of_wall.wall
        ),
        _INCOMPRESSIBLE.format(bulk=bulk),
    ]
    if any("beta" in layer.energy.parameter_names for layer in of_wall.wall):
        header.append(_AXES)
    return made_for.write(header, materials)


def _one_of[T](name: str, value: str, choices: dict[str, T]) -> T:
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name} is {value!r}; expected one of {list(choices)}")
    return choices[value]


def _check_law(energy: StrainEnergy, code: Code) -> None:
    """Raise ValueError unless the code has the law."""
    law = type(energy)
    if law in code.laws:
        return
    others = [other.label for other in _CODES.values() if law in other.laws]
    reason, available = code.reasons.get(law), ", ".join(has.__name__ for has in code.laws)
    raise ValueError(
        f"{energy.name} has no card for {code.label}"
        + (f": {reason}" if reason else "")
        + f". {code.label} has {available}; {energy.name} has "
        + (f"a card for {', '.join(others)}" if others else "none for any code")
    )


def _material(
    of_wall: WallDraws, place: int, at: PointOfWall, stress: str, given: float | None
) -> Material:
    """Return the material of one layer at a point of the posterior."""
    energy, count = of_wall.wall[place].energy, len(of_wall.wall)
    values = in_units(energy, at.values[place], stress)
    name = "wall" if count == 1 else f"layer_{place + 1}"
    listed = []
    for p in energy.parameters:
        unit = stress if p.unit == "kPa" else p.unit
        listed.append(f"{p.name} = {values[p.name]!r} {unit}".rstrip())
    notes = f"{name}{at.suffix}: {energy!r}, {', '.join(listed)}"
    if at.suffix:
        notes += f"; {at.words}"
    if "thickness" in at.values[place]:
        thickness = float(at.values[place]["thickness"])
        notes += f"; layer {place + 1} of {count} from the inside, {thickness!r} mm thick at rest"
    bulk = bulk_modulus_of(energy, values, given)
    return Material(name + at.suffix, energy, values, bulk, [notes])


def _source_note(tree: xr.DataTree, of_wall: WallDraws) -> str:
    """Return a sentence with the specimen and the data of the posterior, names escaped to ASCII."""
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


def _draws_note(count: int, of_wall: WallDraws) -> list[str]:
    if not count:
        return []
    sizes = of_wall.member.posterior.sizes
    return [
        f"Materials with _draw_ in their name: {count} of the {sizes['chain'] * sizes['draw']} "
        "draws of the posterior, evenly spaced along its chains."
    ]
