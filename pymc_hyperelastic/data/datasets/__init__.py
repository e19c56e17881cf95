"""Data of tubes and of sheets that come with the package, each with its source."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.data.sheet_table import sheet_data
from pymc_hyperelastic.data.table import inflation_data
from pymc_hyperelastic.mechanics.reference_tube import Tube
from pymc_hyperelastic.mechanics.tube import internal_radius_from_outer_radius


def list_datasets() -> dict[str, str]:
    """List the datasets that come with the package.

    Returns
    -------
    dict of str to str
        Name and description in one line.

    See Also
    --------
    load_dataset

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> [*ph.list_datasets()][:3]
    ['simulated_sheep_aorta', 'murine_pulmonary_artery', 'treloar_rubber']
    >>> ph.list_datasets()["treloar_rubber"]
    'Measured tests of rubber sheets: uniaxial, equibiaxial and pure shear.'
    """
    return {name: shipped.description for name, shipped in _SHIPPED.items()}


def load_dataset(name: str) -> xr.Dataset:
    """Load a dataset that comes with the package.

    Parameters
    ----------
    name : str
        One of the names of :func:`list_datasets`.

    Returns
    -------
    xarray.Dataset
        Data of tubes (mm, kPa), see :func:`pymc_hyperelastic.inflation_data`, or of sheets (kPa),
        see :func:`pymc_hyperelastic.sheet_data`, with the attributes ``title``, ``description``,
        ``source`` and ``simulated`` (1 or 0).

    Raises
    ------
    ValueError
        If there is no dataset of that name.

    See Also
    --------
    list_datasets, read_tests, combine_tests

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> data.attrs["title"], data.attrs["simulated"]
    ('SIMULATED sheep aorta', 1)
    >>> rubber = ph.load_dataset("treloar_rubber")
    >>> rubber["experiment"].values.tolist(), rubber["stress_measure"].values[0].item()
    (['uniaxial', 'equibiaxial', 'pure shear'], 'nominal')
    """
    if name not in _SHIPPED:
        names = ", ".join(repr(known) for known in _SHIPPED)
        raise ValueError(f"no dataset {name!r}; there are {names}")
    shipped = _SHIPPED[name]
    with files(__package__).joinpath(f"{name}.csv").open(encoding="utf-8") as file:
        frame = pd.read_csv(file, comment="#")
    return shipped.build(frame).assign_attrs(
        title=shipped.title,
        description=shipped.description,
        source=shipped.source,
        # An integer, because netCDF has no truth values.
        simulated=int(shipped.simulated),
    )


def _simulated_sheep_aorta(frame: pd.DataFrame) -> xr.Dataset:
    return inflation_data(
        frame.rename(columns={"radius_mm": "radius", "pressure_mmHg": "pressure"}),
        Tube(inner_radius="inner_radius_mm", outer_radius="outer_radius_mm"),
        pressure_unit="mmHg",
    )


def _murine_pulmonary_artery(frame: pd.DataFrame) -> xr.Dataset:
    # The unloaded vessel was not measured. The reference is the tube as mounted: axially stretched
    # and without pressure; a wall of constant area then gives all inner radii.
    current_outer = frame["outer_diameter_um"] / 2
    outer = current_outer.groupby(frame["specimen"]).transform("first")
    inner = np.sqrt(outer**2 - frame["wall_area_um2"] / np.pi)
    radius = internal_radius_from_outer_radius(
        current_outer, inner_radius=inner, outer_radius=outer
    )
    return inflation_data(
        frame.assign(radius=radius, inner=inner, outer=outer, pressure=frame["pressure_mmHg"]),
        Tube(inner_radius="inner", outer_radius="outer"),
        radius_unit="um",
        pressure_unit="mmHg",
    )


def _treloar_rubber(frame: pd.DataFrame) -> xr.Dataset:
    frame = frame.rename(columns={"nominal_stress_MPa": "stress"})
    return sheet_data(frame, stress="nominal", kind="experiment", stress_unit="MPa")


def _porcine_skin(frame: pd.DataFrame) -> xr.Dataset:
    names = {f"cauchy_stress_{axis}_MPa": f"stress_{axis}" for axis in "xy"}
    return sheet_data(frame.rename(columns=names), stress="cauchy", stress_unit="MPa")


def _human_myocardium(frame: pd.DataFrame) -> xr.Dataset:
    axes = {"x": "fibre", "y": "cross_fibre"}
    names = {f"stretch_{direction}": f"stretch_{axis}" for axis, direction in axes.items()}
    names |= {f"nominal_stress_{of}_kPa": f"stress_{axis}" for axis, of in axes.items()}
    return sheet_data(frame.rename(columns=names), stress="nominal")


@dataclass(frozen=True)
class _Shipped:
    title: str
    description: str
    source: str
    simulated: bool
    build: Callable[[pd.DataFrame], xr.Dataset]


_SHIPPED = {
    "simulated_sheep_aorta": _Shipped(
        title="SIMULATED sheep aorta",
        description="SIMULATED inflation of 5 aortas, 3 experiments each, in two groups (C1, C2).",
        source=(
            "SIMULATED, not measured: a two-fibre-family exponential tube with variability and "
            "errors, made by docs/simulate_sheep_aorta.py."
        ),
        simulated=True,
        build=_simulated_sheep_aorta,
    ),
    "murine_pulmonary_artery": _Shipped(
        title="Mouse left pulmonary artery, control and hypertensive",
        description="Measured inflation of mouse pulmonary arteries: one mean curve a group.",
        source=(
            "D. M. Tabima and N. C. Chesler, The effects of vasoactivity and hypoxic pulmonary "
            "hypertension on extralobar pulmonary artery biomechanics, Journal of Biomechanics 43 "
            "(2010) 1864-1869, as tabulated with M. A. Haider, K. J. Pearce, N. C. Chesler, "
            "N. A. Hill and M. S. Olufsen, arXiv:2202.12711 (2022)."
        ),
        simulated=False,
        build=_murine_pulmonary_artery,
    ),
    "treloar_rubber": _Shipped(
        title="Treloar's rubber",
        description="Measured tests of rubber sheets: uniaxial, equibiaxial and pure shear.",
        source=(
            "L. R. G. Treloar, Stress-strain data for vulcanised rubber under various types of "
            "deformation, Transactions of the Faraday Society 40 (1944) 59-70."
        ),
        simulated=False,
        build=_treloar_rubber,
    ),
    "porcine_skin": _Shipped(
        title="Porcine skin",
        description=("Measured biaxial tests of a specimen of porcine skin, 5 protocols, thinned."),
        source=(
            "V. Tac, F. Sahli Costabal and A. Buganza Tepole, Data-driven tissue mechanics with "
            "polyconvex neural ordinary differential equations, Computer Methods in Applied "
            "Mechanics and Engineering 398 (2022) 115248, as in LivingMatterLab/CANN; thinned to "
            "15 of 72 to 101 points a protocol."
        ),
        simulated=False,
        build=_porcine_skin,
    ),
    "human_myocardium": _Shipped(
        title="Human ventricular myocardium",
        description=(
            "Measured biaxial tests of human myocardium, 5 ratios of strains: mean curves."
        ),
        source=(
            "G. Sommer, A. J. Schriefl, M. Andrä, M. Sacherer, C. Viertler, H. Wolinski and G. A. "
            "Holzapfel, Biomechanical properties and microstructure of human ventricular "
            "myocardium, Acta Biomaterialia 24 (2015) 172-192, as tabulated with "
            "LivingMatterLab/CANN."
        ),
        simulated=False,
        build=_human_myocardium,
    ),
}
