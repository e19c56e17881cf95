"""The figures of a study, in the manner of arviz-plots: each returns a PlotCollection."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import expit, logit
from scipy.stats import gaussian_kde

from pymc_hyperelastic.data import check_inflation_data, points_of
from pymc_hyperelastic.mixture import GaussianMixture
from pymc_hyperelastic.models import predict_pressure
from pymc_hyperelastic.results import inflation_data_of
from pymc_hyperelastic.strain_energy import StrainEnergy
from pymc_hyperelastic.units import to_internal

# arviz_plots brings matplotlib along: it is imported when the first figure is drawn.
if TYPE_CHECKING:
    from arviz_plots import PlotCollection

__all__ = [
    "plot_class_probability",
    "plot_inflation",
    "plot_parameter_density",
    "plot_pressure_fit",
]

Array = NDArray[np.float64]
Backend = Literal["matplotlib", "none"]
Visuals = Mapping[str, Mapping[str, Any] | bool]

# Okabe and Ito's palette, told apart with any colour vision and in grey; the yellow is left out.
PALETTE = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000"]
MARKERS = ["o", "^", "s", "d", "x", "+", "."]

_LABELS = ("group", "specimen", "experiment")
_GEOMETRY = ("inner_radius", "outer_radius", "axial_stretch", "opening_angle")
_RADIUS_LABEL = "internal radius $a$ (mm)"
_SYMBOLS = {"sigma": r"\sigma", "slope_weight": r"\beta"}
_MOST_DRAWS = 2000  # of a class in one figure: more change no line visibly
_GRID = 100  # points along each side of the grid on which a density is computed
_CURVE = 80  # points of a posterior curve


def plot_inflation(
    data: xr.Dataset,
    *,
    group_by: Literal["group", "specimen", "experiment"] | None = "group",
    pressure_unit: str = "mmHg",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the measured curves: pressure over internal radius.

    Colours tell specimens apart, or groups where a panel holds several; markers tell experiments.

    Parameters
    ----------
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`.
    group_by : {"group", "specimen", "experiment"} or None
        What has a panel of its own; with None all curves share one.
    pressure_unit : str
        Unit of the pressure axis, as pint knows it.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``line``, ``points``, ``xlabel``, ``ylabel``, ``title`` (of a panel) and
        ``legend``; False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.wrap`.

    Returns
    -------
    arviz_plots.PlotCollection
        Its title is that of the data, and says whether they are simulated.

    Raises
    ------
    TypeError, ValueError
        If the data are unsound, or `group_by`, the unit, the backend or a visual is unknown.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> figure = ph.plot_inflation(ph.load_dataset("simulated_sheep_aorta"), backend="none")
    >>> figure.viz["plot"]["group"].values
    array(['C1', 'C2'], dtype='<U2')
    """
    from arviz_plots import PlotCollection
    from arviz_plots.visuals import (
        labelled_title,
        labelled_x,
        labelled_y,
        line_xy,
        scatter_xy,
        set_xlim,
    )

    check_inflation_data(data)
    if group_by not in (*_LABELS, None):
        raise ValueError(f"group_by must be one of {', '.join(_LABELS)} or None, not {group_by!r}")
    visuals = _checked(visuals, backend, "line points xlabel ylabel title legend")
    curves = _curves(data, 1 / float(to_internal(1.0, pressure_unit, "pressure")))
    several = [n for n in _LABELS if curves.sizes[n] > 1 and n != group_by]
    # The coarser of the labels that share a panel: groups, or else specimens, or else experiments.
    colour = several[0] if several else "specimen"
    marker = "experiment" if "experiment" in several and colour != "experiment" else None
    aesthetics = {"color": [colour], "overlay": list(_LABELS)} | (
        {"marker": [marker]} if marker else {}
    )
    panels = curves.sizes[group_by] if group_by else 1
    columns = min(panels, 3)
    pc = PlotCollection.wrap(
        curves,
        cols=[group_by] if group_by else [],
        backend=backend,
        **_collection(
            pc_kwargs,
            (3.0 * columns + (1.2 if panels > 1 else 2.2), 2.9 * -(-panels // 3) + 0.3),
            {"sharey": True},
            col_wrap=3,
            aes=aesthetics,
            color=PALETTE,
            **({"marker": MARKERS} if marker else {}),
        ),
    )
    _draw(pc, visuals, "line", line_xy, width=0.8, alpha=0.7, ignore_aes={"marker"} & pc.aes_set)
    _draw(pc, visuals, "points", scatter_xy, size=10, width=0.8)
    alone = {"ignore_aes": "all"}
    low, high = data["radius"].values.min(), data["radius"].values.max()
    margin = 0.04 * (high - low)
    pc.map(set_xlim, limits=(low - margin, high + margin), store_artist=False, **alone)
    _draw(pc, visuals, "xlabel", labelled_x, text=_RADIUS_LABEL, **alone)
    names = curves[group_by].values.tolist() if group_by else [None]
    for i, name in enumerate(names):
        here = {"coords": {group_by: name}} if group_by else {}
        if i % columns == 0:
            text = f"pressure ({pressure_unit})"
            _draw(pc, visuals, "ylabel", labelled_y, text=text, **alone, **here)
        if panels > 1:
            text = f"{group_by} {name}"
            _draw(pc, visuals, "title", labelled_title, text=text, size="medium", **alone, **here)
    entries = _entries(pc, colour, "color", marker="o", markersize=4) if several else {}
    if marker:
        entries |= _entries(pc, marker, "marker", color="0.3", linestyle="none", markersize=5)
    _legend(pc, visuals, entries)
    _add_title(pc, [data.attrs])
    return pc


def plot_parameter_density(
    classes: xr.DataTree,
    *,
    var_names: Sequence[str] | None = None,
    probs: Sequence[float] = (0.5, 0.94),
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    r"""Plot the joint posterior of two parameters, a colour for each class.

    The filled regions are those of highest density that hold the given probabilities. Where a
    posterior has modes far apart, such as the mirrored ones of ``α`` and ``−α``, the axis is
    broken, so that each mode is seen in a panel of its own scale.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`pymc_hyperelastic.fit_classes`, one of its classes, or a sampled model.
    var_names : sequence of two str, optional
        What is shown on the horizontal and the vertical axis; the first two variables when missing.
    probs : sequence of float
        Probabilities that the regions hold.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``area``, ``line``, ``xlabel``, ``ylabel`` and ``legend``; False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.grid`.

    Returns
    -------
    arviz_plots.PlotCollection
        Its dimensions ``y_part`` and ``x_part`` count the pieces of the broken axes.

    Raises
    ------
    TypeError
        If `classes` is not a DataTree.
    ValueError
        If there is no posterior, or a variable, a probability, a backend or a visual is unknown.

    Notes
    -----
    The density is a sum of kernels. A kernel has the shape of the component to which its draw
    belongs in a Gaussian mixture fitted to the mode: narrow modes and bent ridges are not smeared
    by the spread of the whole, nor does a kernel reach beyond the ends of a uniform prior.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> classes = ph.fit_classes(
    ...     ph.Ogden(),
    ...     {name: ph.select(data, group=name, experiment=[1, 2]) for name in ("C1", "C2")},
    ...     sigma=5 * ph.mmHg,
    ...     slope_weight=3.0,
    ...     draws=500,
    ...     chains=2,
    ...     random_seed=1,
    ...     progressbar=False,
    ... )
    >>> figure = ph.plot_parameter_density(classes, backend="none")
    >>> figure.viz["plot"].sizes["y_part"]  # one for each sign of alpha
    2
    """
    from arviz_plots import PlotCollection
    from arviz_plots.visuals import labelled_x, labelled_y, set_xlim, set_ylim

    visuals = _checked(visuals, backend, "area line xlabel ylabel legend")
    fitted = _fitted(classes)
    names = _two_variables(fitted, var_names)
    probs = sorted(probs, reverse=True)
    if not probs or not all(0 < prob < 1 for prob in probs):
        raise ValueError(f"probs must hold probabilities between 0 and 1; got {probs}")
    density = _densities(fitted, names, probs)
    rows, columns = density.sizes["y_part"], density.sizes["x_part"]
    pc = PlotCollection.grid(
        density[["density"]],
        rows=["y_part"],
        cols=["x_part"],
        backend=backend,
        **_collection(
            pc_kwargs,
            (3.6 * columns + 1.6, (2.2 if rows > 1 else 3.2) * rows + 0.5),
            {"sharex": "col", "sharey": "row"},
            aes={"color": ["class_label"]},
            color=PALETTE,
        ),
    )
    levels = {key: density[key] for key in ("x", "y", "level")} | {"peak": density["peak"]}
    each = {"artist_dims": {"prob": len(probs)}}
    _draw(pc, visuals, "area", _contours, kind="contourf", alpha=0.4, **levels, **each)
    _draw(pc, visuals, "line", _contours, kind="contour", linewidths=1.2, **levels, **each)
    alone = {"ignore_aes": "all"}
    tree = next(iter(fitted.values()))
    for part in range(columns):
        where = {"coords": {"y_part": rows - 1, "x_part": part}} | alone
        limits = density["x_limits"].values[part].tolist()
        pc.map(set_xlim, limits=limits, store_artist=False, **where)
        _draw(pc, visuals, "xlabel", labelled_x, text=_axis_label(tree, names[0]), **where)
    for part in range(rows):
        where = {"coords": {"y_part": part, "x_part": 0}} | alone
        limits = density["y_limits"].values[part].tolist()
        pc.map(set_ylim, limits=limits, store_artist=False, **where)
        _draw(pc, visuals, "ylabel", labelled_y, text=_axis_label(tree, names[1]), **where)
    regions = " and ".join(f"{100 * prob:.3g} %" for prob in reversed(probs))
    entries = _entries(pc, "class_label", "color", prefix="", linewidth=5, alpha=0.7)
    _legend(pc, visuals, entries, title=f"posterior,\n{regions}")
    attrs = [f["constant_data"].attrs for f in fitted.values() if "constant_data" in f.children]
    _add_title(pc, attrs, tree.attrs.get("strain_energy"))
    return pc


def plot_pressure_fit(
    classes: xr.DataTree,
    data: xr.Dataset | Mapping[str, xr.Dataset] | None = None,
    *,
    prob: float = 0.94,
    energy: StrainEnergy | None = None,
    pressure_unit: str = "mmHg",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the posterior of pressure and of stiffness over the data, a column for each class.

    The band is that of the tube's response, without measurement error: it is as narrow as the
    parameters are well known, and data may lie beside it.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`pymc_hyperelastic.fit_classes`, one of its classes, or a sampled model.
    data : xarray.Dataset or dict of str to xarray.Dataset, optional
        What is shown with the posterior: inflation data, or those for each class. The training
        data when missing. Tests on tubes of other dimensions have bands of their own.
    prob : float
        Probability that the band holds at each radius, with equal tails.
    energy : StrainEnergy, optional
        The material; needed where the result does not name it.
    pressure_unit : str
        Unit of the pressure axis, as pint knows it.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``band``, ``median``, ``points``, ``xlabel``, ``ylabel``, ``title`` (of a
        column) and ``legend``; False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.grid`.

    Returns
    -------
    arviz_plots.PlotCollection
        Its variables are ``pressure`` and ``stiffness``.

    Raises
    ------
    TypeError
        If `classes` is not a DataTree.
    ValueError
        If there is no posterior, no data or no strain energy, the data are unsound or lack a
        class, or `prob`, the unit, the backend or a visual is unknown.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    >>> model = ph.ogden_model(data, sigma=5 * ph.mmHg, slope_weight=3.0)
    >>> tree = ph.sample_smc(model, draws=500, chains=2, random_seed=1, progressbar=False)
    >>> figure = ph.plot_pressure_fit(tree, data, backend="none")
    >>> list(figure.viz["plot"].data_vars)
    ['pressure', 'stiffness']
    """
    from arviz_plots import PlotCollection
    from arviz_plots.visuals import (
        fill_between_y,
        labelled_title,
        labelled_x,
        labelled_y,
        line_xy,
        scatter_xy,
    )

    visuals = _checked(visuals, backend, "band median points xlabel ylabel title legend")
    fitted = _fitted(classes)
    if not 0 < prob < 1:
        raise ValueError(f"prob must be a probability between 0 and 1, not {prob}")
    shown = {name: _data_of(name, tree, data) for name, tree in fitted.items()}
    per_kilopascal = 1 / float(to_internal(1.0, pressure_unit, "pressure"))
    posterior = _side_by_side(
        {n: _posterior_curves(fitted[n], shown[n], prob, energy, per_kilopascal) for n in fitted}
    )
    measured = _side_by_side({n: _measured(shown[n], per_kilopascal) for n in fitted})
    pc = PlotCollection.grid(
        posterior,
        rows=["__variable__"],
        cols=["class_label"],
        backend=backend,
        **_collection(
            pc_kwargs,
            (max(2.9 * len(fitted) + 0.9, 5.0), 5.6),
            {"sharex": "col", "sharey": "row"},
            aes={"color": ["class_label"], "overlay": ["tube"]},
            color=PALETTE,
        ),
    )
    band = posterior.sel(plot_axis=["x", "y_bottom", "y_top"]).rename(plot_axis="kwarg")
    grey = {"color": "0.25", "ignore_aes": pc.aes_set}
    _draw(pc, visuals, "band", fill_between_y, data=band, alpha=0.35, linewidth=0)
    _draw(pc, visuals, "points", scatter_xy, data=measured, size=7, alpha=0.6, **grey)
    _draw(pc, visuals, "median", line_xy, data=posterior.sel(plot_axis=["x", "y"]), width=1.5)
    alone = {"ignore_aes": "all"}
    labels = {
        "pressure": f"pressure ({pressure_unit})",
        "stiffness": f"stiffness d$p$/d$a$ ({pressure_unit}/mm)",
    }
    for i, name in enumerate(fitted):
        where = {"coords": {"class_label": name}}
        bottom, top = posterior[["stiffness"]], posterior[["pressure"]]
        _draw(pc, visuals, "xlabel", labelled_x, data=bottom, text=_RADIUS_LABEL, **where, **alone)
        if len(fitted) > 1:
            text = f"class {name}"
            size = {"size": "medium"}
            _draw(
                pc, visuals, "title", labelled_title, data=top, text=text, **size, **where, **alone
            )
        for key, text in labels.items() if i == 0 else ():
            _draw(
                pc,
                visuals,
                "ylabel",
                labelled_y,
                data=posterior[[key]],
                text=text,
                **where,
                **alone,
            )
    _legend(
        pc,
        visuals,
        {
            "data": {"color": "0.25", "marker": "o", "markersize": 3, "linestyle": "none"},
            "posterior median": {"color": "0.4", "linewidth": 1.5},
            f"{100 * prob:.3g} % of the posterior": {"color": "0.4", "linewidth": 6, "alpha": 0.35},
        },
        loc="outside lower center",
        ncols=3,
    )
    tree = next(iter(fitted.values()))
    name = energy.name if energy else tree.attrs.get("strain_energy")
    _add_title(pc, [d.attrs for d in shown.values()], name)
    return pc


def plot_class_probability(
    result: xr.Dataset | Mapping[str, xr.Dataset],
    *,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the probability of each class: a row for each new experiment, a bar for each class.

    Parameters
    ----------
    result : xarray.Dataset or dict of str to xarray.Dataset
        Result of :func:`pymc_hyperelastic.classify`; of a dict, such as one of strain energies,
        each has a column. What is not yet classified (NaN) has no bar.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``bar``, ``error`` (one standard error to each side), ``number``, ``xlabel``,
        ``ylabel`` and ``title`` (of a row); False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.grid`.

    Returns
    -------
    arviz_plots.PlotCollection
        With the dimensions ``model`` (column), ``test`` or ``specimen`` (row), and
        ``class_label``.

    Raises
    ------
    TypeError
        If `result` is not a Dataset or a dict of them.
    ValueError
        If it holds no class probabilities, results of a dict differ in their experiments or
        classes, or a backend or a visual is unknown.

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> result = xr.Dataset(
    ...     {
    ...         "class_probability": (("specimen", "class_label"), [[0.9, 0.1]]),
    ...         "class_probability_se": (("specimen", "class_label"), [[0.02, 0.02]]),
    ...     },
    ...     {"specimen": ["S1"], "class_label": ["C1", "C2"]},
    ... )
    >>> figure = ph.plot_class_probability(result, backend="none")
    >>> figure.get_viz("number", class_label="C1")["string"]
    '0.900'
    """
    from arviz_plots import PlotCollection
    from arviz_plots.visuals import (
        annotate_xy,
        ci_line_y,
        hist,
        labelled_title,
        labelled_x,
        labelled_y,
        set_xticks,
        set_ylim,
    )

    visuals = _checked(visuals, backend, "bar error number xlabel ylabel title")
    results = (
        dict(result)
        if isinstance(result, Mapping) and not isinstance(result, xr.Dataset)
        else {"": result}
    )
    row, headings = _rows(results)
    table = xr.concat(
        [
            r[["class_probability", "class_probability_se"]].reset_coords(drop=True)
            for r in results.values()
        ],
        dim="model",
    ).assign_coords({"model": list(results), row: headings})
    probability = table["class_probability"]
    error = table["class_probability_se"]
    labels = table["class_label"].values.tolist()
    width = max(1.0 + 0.55 * len(labels), 2.2)
    place = xr.DataArray(np.arange(len(labels)), dims="class_label")
    place = place.where(probability.notnull())  # no bar where nothing is known

    pc = PlotCollection.grid(
        table[["class_probability"]],
        rows=[row],
        cols=["model"],
        backend=backend,
        **_collection(
            pc_kwargs,
            (max(width * len(results) + 0.8, 3.6), 1.25 * len(headings) + 0.7),
            {"sharex": True, "sharey": True},
            aes={"color": ["class_label"]},
            color=PALETTE,
        ),
    )
    bars = _stacked(left_edges=place - 0.35, right_edges=place + 0.35, histogram=probability)
    _draw(pc, visuals, "bar", hist, data=bars.expand_dims("bar", axis=-1), alpha=0.75)
    reach = {
        "y_bottom": (probability - error).clip(0, 1),
        "y_top": (probability + error).clip(0, 1),
    }
    black = {"color": "0.1", "width": 1.2}
    _draw(pc, visuals, "error", ci_line_y, data=_stacked(x=place, **reach), **black)
    _draw(
        pc,
        visuals,
        "number",
        annotate_xy,
        text=_number,
        x=place,
        y=reach["y_top"] + 0.04,
        vertical_align="bottom",
        color="0.1",
        size=8,
    )
    alone = {"ignore_aes": "all"}
    pc.map(set_ylim, limits=(0, 1.3), store_artist=False, **alone)
    pc.map(_probability_ticks, store_artist=False, **alone)
    pc.map(set_xticks, values=range(len(labels)), labels=labels, store_artist=False, **alone)
    for model, of_model in results.items():
        law = model or of_model.attrs.get("strain_energy", "")
        where = {"coords": {row: headings[-1], "model": model}}
        text = f"class ({law})" if law else "class"
        _draw(pc, visuals, "xlabel", labelled_x, text=text, **where, **alone)
    for heading in headings:
        where = {"coords": {row: heading, "model": next(iter(results))}}
        _draw(pc, visuals, "ylabel", labelled_y, text="probability", **where, **alone)
        style = {"size": "small", "loc": "left"}
        _draw(pc, visuals, "title", labelled_title, text=heading, **style, **where, **alone)
    _add_title(pc, [r.attrs for r in results.values()], "class probabilities")
    return pc


# What all figures share: settings, titles, legends.


def _checked(visuals: Visuals | None, backend: str, known: str) -> Visuals:
    if backend not in ("matplotlib", "none"):
        raise ValueError(f"backend must be 'matplotlib' or 'none', not {backend!r}")
    unknown = [name for name in visuals or () if name not in known.split()]
    if unknown:
        raise ValueError(f"no visual is called {unknown[0]!r}; there are {known.split()}")
    return visuals or {}


def _collection(
    given: dict[str, Any], figsize: tuple[float, float], figure: dict[str, Any], **defaults: Any
) -> dict[str, Any]:
    """Settings of a PlotCollection: what the user gave goes before the defaults."""
    figure = {"figsize": figsize, "layout": "constrained"} | figure
    return defaults | given | {"figure_kwargs": figure | given.get("figure_kwargs", {})}


def _draw(pc: PlotCollection, visuals: Visuals, name: str, function: Any, **settings: Any) -> None:
    chosen = visuals.get(name, True)
    if chosen is not False:
        pc.map(function, name, **(settings | ({} if chosen is True else dict(chosen))))


def _entries(
    pc: PlotCollection, dim: str, key: str, prefix: str | None = None, **style: Any
) -> dict[str, dict[str, Any]]:
    """Legend entries of the values of `dim`, which the aesthetic `key` tells apart."""
    mapping = pc.aes[key]["mapping"]
    prefix = f"{dim} " if prefix is None else prefix
    return {
        f"{prefix}{label}": style | {key: mapping.sel({dim: label}).item()}
        for label in mapping[dim].values.tolist()
    }


def _legend(
    pc: PlotCollection,
    visuals: Visuals,
    entries: dict[str, dict[str, Any]],
    loc: str = "outside center right",
    **settings: Any,
) -> None:
    from importlib import import_module

    chosen = visuals.get("legend", True)
    if chosen is False or len(entries) < 2:
        return
    settings = {"frameon": False, "fontsize": "small", "loc": loc} | settings
    legend = import_module(f"arviz_plots.backend.{pc.backend}").legend
    pc.viz["legend"] = xr.DataArray(
        np.array(
            legend(
                pc,
                list(entries.values()),
                list(entries),
                **(settings | ({} if chosen is True else dict(chosen))),
            ),
            dtype=object,
        )
    )


def _add_title(pc: PlotCollection, attrs: Sequence[Mapping[Any, Any]], *before: str | None) -> None:
    """Title of the figure: what is shown, and of which data; simulated data are called so."""
    titles = dict.fromkeys(str(a["title"]) for a in attrs if a.get("title"))
    text = ", ".join([*filter(None, before), *titles])
    if any(a.get("simulated") for a in attrs) and "simulated" not in text.lower():
        text = f"{text}, SIMULATED data" if text else "SIMULATED data"
    if text:
        pc.add_title(text, size="medium", wrap=True)


def _stacked(**arrays: xr.DataArray) -> xr.Dataset:
    """The coordinates of something to draw, along the dimension that visuals read."""
    stacked = xr.concat(arrays.values(), dim="plot_axis").assign_coords(plot_axis=list(arrays))
    return stacked.to_dataset(name="class_probability")


# What is drawn of inflation data.


def _curves(data: xr.Dataset, pressure_factor: float) -> xr.Dataset:
    """Curves by label: each is a dimension, so that panels and colours follow from it."""
    labels = [data[name].values.tolist() for name in _LABELS]
    coords = {n: list(dict.fromkeys(values)) for n, values in zip(_LABELS, labels, strict=True)}
    tests = [points_of(data, i) for i in range(data.sizes["test"])]
    longest = max(test.stop - test.start for test in tests)
    curves = np.full((*map(len, coords.values()), 2, longest), np.nan)
    for of_test, test in zip(zip(*labels, strict=True), tests, strict=True):
        place = tuple(coords[n].index(label) for n, label in zip(_LABELS, of_test, strict=True))
        curve = curves[place][:, : test.stop - test.start]
        curve[0] = data["radius"].values[test]
        curve[1] = pressure_factor * data["pressure"].values[test]
    dims = (*_LABELS, "plot_axis", "point")
    return xr.Dataset({"pressure": (dims, curves)}, {**coords, "plot_axis": ["x", "y"]})


def _measured(data: xr.Dataset, pressure_factor: float) -> xr.Dataset:
    """Measured pressures, and their central differences inside each test."""
    pressure, stiffness = [], []
    for i in range(data.sizes["test"]):
        test = points_of(data, i)
        r, p = data["radius"].values[test], pressure_factor * data["pressure"].values[test]
        pressure.append([r, p])
        step = r[2:] - r[:-2]
        step[step == 0] = np.nan
        stiffness.append([r[1:-1], (p[2:] - p[:-2]) / step])
    points = {"pressure": pressure, "stiffness": stiffness}
    return xr.merge(
        [
            xr.DataArray(
                np.concatenate(values, axis=1),
                {"plot_axis": ["x", "y"], "point": range(sum(len(v[0]) for v in values))},
                name=name,
            )
            for name, values in points.items()
        ],
        join="outer",
    )


# What is drawn of posteriors.


def _fitted(classes: xr.DataTree) -> dict[str, xr.DataTree]:
    """Sampled models by class; a single one has the name of its group."""
    if not isinstance(classes, xr.DataTree):
        raise TypeError(
            "expected a DataTree, the result of ph.fit_classes or ph.sample_smc, not "
            f"{type(classes).__name__}"
        )
    if "posterior" in classes.children:
        return {classes.name or "posterior": classes}
    fitted = {str(n): tree for n, tree in classes.children.items() if "posterior" in tree.children}
    if not fitted:
        raise ValueError(
            "the result holds no posterior; it comes from ph.fit_classes or ph.sample_smc"
        )
    return fitted


def _data_of(name: str, tree: xr.DataTree, data: Any) -> xr.Dataset:
    """Inflation data to be shown with a class."""
    if isinstance(data, Mapping) and not isinstance(data, xr.Dataset):
        if name not in data:
            raise ValueError(f"data has nothing for class {name!r}; it has {list(data)}")
        data = data[name]
    elif data is None:
        if "inner_radius" not in tree.children.get("constant_data", {}):
            raise ValueError(f"{name!r} holds no inflation data: give them as data=...")
        data = inflation_data_of(tree)
    check_inflation_data(data)
    return data


def _posterior_curves(
    tree: xr.DataTree,
    data: xr.Dataset,
    prob: float,
    energy: StrainEnergy | None,
    pressure_factor: float,
) -> xr.Dataset:
    """Median and band of pressure and stiffness for each of the tubes of the data."""
    posterior = tree["posterior"].to_dataset()
    step = -(-posterior.sizes["chain"] * posterior.sizes["draw"] // _MOST_DRAWS)
    thinned = xr.DataTree.from_dict({"posterior": posterior.isel(draw=slice(None, None, step))})
    thinned.attrs = tree.attrs
    geometry = np.stack([data[name].values for name in _GEOMETRY], axis=1)
    tubes, tube_of_test = np.unique(geometry, axis=0, return_inverse=True)
    curves = []
    for i, tube in enumerate(tubes):
        radius = data["radius"].values[
            np.isin(data["test"].values, np.flatnonzero(tube_of_test == i))
        ]
        grid = np.linspace(radius.min(), radius.max(), _CURVE)
        known = dict(zip(_GEOMETRY, tube.tolist(), strict=True))
        curve = predict_pressure(thinned, grid, energy=energy, **known) * pressure_factor
        quantiles = curve.quantile([0.5, (1 - prob) / 2, (1 + prob) / 2], dim=["chain", "draw"])
        x = xr.full_like(quantiles.isel(quantile=[0]), 0) + quantiles["radius"]
        curves.append(
            xr.concat([x, quantiles], dim="quantile")
            .drop_vars(["quantile", "radius"])
            .rename(quantile="plot_axis", radius="point")
            .assign_coords(plot_axis=["x", "y", "y_bottom", "y_top"])
        )
    return xr.concat(curves, dim="tube").assign_coords(tube=range(len(curves)))


def _side_by_side(of_class: dict[str, xr.Dataset]) -> xr.Dataset:
    """Join what is drawn for each class; what one has more of is NaN in the other."""
    names = xr.DataArray(list(of_class), dims="class_label", name="class_label")
    return xr.concat(of_class.values(), dim=names, join="outer", fill_value=np.nan)


def _two_variables(
    fitted: dict[str, xr.DataTree], var_names: Sequence[str] | None
) -> tuple[str, str]:
    """Names of the variables on the two axes."""
    scalar = [
        [n for n, v in tree["posterior"].to_dataset().items() if set(v.dims) == {"chain", "draw"}]
        for tree in fitted.values()
    ]
    common = [str(name) for name in scalar[0] if all(name in names for names in scalar)]
    names = tuple(common[:2] if var_names is None else var_names)
    unknown = [name for name in names if name not in common]
    if unknown or isinstance(var_names, str) or len(set(names)) != 2:
        raise ValueError(
            f"two different variables are needed, not {var_names or names}; scalars in the "
            f"posterior of every class are {common} (for one variable see arviz.plot_dist)"
        )
    return names[0], names[1]


def _axis_label(tree: xr.DataTree, name: str) -> str:
    """Symbol and unit of a variable."""
    symbols = dict(_SYMBOLS)
    try:
        energy = StrainEnergy.from_name(tree.attrs.get("strain_energy", ""))
        symbols |= {p.name: p.symbol for p in energy.parameters}
    except ValueError:
        pass  # a law of the user's own that is not defined here: its names have to do
    units = json.loads(tree.attrs.get("units", "{}"))
    unit = units.get(name, "").replace("mm2", "mm²")
    label = f"${symbols[name]}$" if name in symbols else name
    return f"{label} ({unit})" if unit else label


def _densities(
    fitted: dict[str, xr.DataTree], names: tuple[str, str], probs: Sequence[float]
) -> xr.Dataset:
    """Density of each class in each piece of the axes, and its levels of highest density."""
    draws = {}
    for label, tree in fitted.items():
        points = np.stack([tree["posterior"][name].values.ravel() for name in names], axis=1)
        draws[label] = points[:: -(-len(points) // _MOST_DRAWS)]
    breaks = [_breaks([points[:, axis] for points in draws.values()]) for axis in (0, 1)]
    shape = (len(draws), len(breaks[1]) + 1, len(breaks[0]) + 1)
    density, mass = np.full((2, *shape, _GRID, _GRID), np.nan)
    grids = np.full((2, *shape, _GRID), np.nan)
    level, peak = np.empty((len(draws), len(probs))), np.empty(len(draws))
    for i, (label, points) in enumerate(draws.items()):
        x_part = np.digitize(points[:, 0], breaks[0])
        y_part = len(breaks[1]) - np.digitize(points[:, 1], breaks[1])  # the highest is on top
        bounds = _uniform_bounds(fitted[label], names)
        for j, k in sorted(set(zip(y_part.tolist(), x_part.tolist(), strict=True))):
            part = points[(y_part == j) & (x_part == k)]
            grids[:, i, j, k], *values = _kernel_density(part, bounds)
            density[i, j, k], mass[i, j, k] = np.multiply(values, len(part) / len(points))
        level[i] = _highest_density_levels(density[i].ravel(), mass[i].ravel(), probs)
        peak[i] = 1.01 * np.nanmax(density[i])
    inside = density >= level.min(axis=1)[:, None, None, None, None]
    x_inside = np.where(inside.any(axis=-1), grids[0], np.nan)
    y_inside = np.where(inside.any(axis=-2), grids[1], np.nan)
    of_part = ("class_label", "y_part", "x_part")
    return xr.Dataset(
        {
            "density": ((*of_part, "i", "j"), density),
            "x": ((*of_part, "i"), grids[0]),
            "y": ((*of_part, "j"), grids[1]),
            "level": (("class_label", "prob"), level),
            "peak": ("class_label", peak),
            "x_limits": (("x_part", "end"), _limits(x_inside, axis=(0, 1, 3))),
            "y_limits": (("y_part", "end"), _limits(y_inside, axis=(0, 2, 3))),
        },
        {
            "class_label": list(draws),
            "y_part": range(shape[1]),
            "x_part": range(shape[2]),
            "prob": list(probs),
        },
    )


def _breaks(values: Sequence[Array]) -> list[float]:
    """Where an axis is broken: in a gap inside a class, wider than what lies on either side."""
    pooled = np.sort(np.concatenate(values))
    gaps = np.diff(pooled)
    widest = int(gaps.argmax())
    low, high = pooled[widest], pooled[widest + 1]
    within = any(v.min() <= low and v.max() >= high for v in values)
    if not within or gaps[widest] < max(low - pooled[0], pooled[-1] - high):
        return []
    return [float(low + high) / 2]


def _uniform_bounds(tree: xr.DataTree, names: tuple[str, str]) -> list[tuple[float, float]]:
    """Ends of the uniform priors; infinite for others."""
    priors = json.loads(tree.attrs.get("priors", "{}"))
    infinite = ["", [-np.inf, np.inf]]
    records = [priors.get(name, infinite) for name in names]
    return [tuple(ends) if kind == "Uniform" else (-np.inf, np.inf) for kind, ends in records]


def _best_mixture(points: Array) -> GaussianMixture:
    """Mixture with as many components as the Bayesian information criterion asks for."""
    most = int(np.clip(len(points) / 200, 1, 4))
    mixtures = [
        GaussianMixture.fit(points, components, np.random.default_rng(components))
        for components in range(1, most + 1)
    ]
    criteria = [
        (6 * len(m.means) - 1) * np.log(len(points)) - 2 * m.log_density(points).sum()
        for m in mixtures
    ]
    return mixtures[int(np.argmin(criteria))]


def _kernel_density(
    points: Array, bounds: Sequence[tuple[float, float]]
) -> tuple[Array, Array, Array]:
    """Density of points (n, 2): a grid (2, grid), and at its nodes the density and the mass."""
    # Between the ends of a prior, distances are those of the log-odds: no kernel reaches beyond,
    # and a ridge that runs into an end stays as narrow as it is.
    free = np.stack([_log_odds(points[:, i], *bounds[i]) for i in (0, 1)], axis=1)
    weight = _best_mixture(free).responsibilities(free)
    counts = np.bincount(weight.argmax(axis=1), minlength=weight.shape[1])
    member = weight[:, counts >= np.minimum(50, counts.max())].argmax(axis=1)
    kernels = [gaussian_kde(free[member == k].T) for k in np.unique(member)]
    widths = 3 * np.sqrt(np.max([np.diag(kernel.covariance) for kernel in kernels], axis=0))
    start, stop = free.min(axis=0) - widths, free.max(axis=0) + widths
    free_grid = np.linspace(start, stop, _GRID, axis=1)
    nodes = np.reshape(np.meshgrid(*free_grid, indexing="ij"), (2, -1))
    values = sum(kernel.n / len(points) * kernel(nodes) for kernel in kernels)
    mass = values.reshape(_GRID, _GRID) * np.prod((stop - start) / (_GRID - 1))
    grid = np.stack([_from_log_odds(free_grid[i], *bounds[i]) for i in (0, 1)])
    # dx dy of each node.
    cell = np.multiply.outer(*np.gradient(grid, axis=1))
    return grid, mass / cell, mass


def _log_odds(x: Array, low: float, high: float) -> Array:
    return logit((x - low) / (high - low)) if np.isfinite(high - low) else x


def _from_log_odds(x: Array, low: float, high: float) -> Array:
    return low + (high - low) * expit(x) if np.isfinite(high - low) else x


def _limits(values: Array, axis: tuple[int, ...]) -> Array:
    """Ends of the range of values, with a margin; shape (..., 2)."""
    low, high = np.nanmin(values, axis=axis), np.nanmax(values, axis=axis)
    margin = 0.08 * (high - low)
    return np.stack([low - margin, high + margin], axis=-1)


def _highest_density_levels(density: Array, mass: Array, probs: Sequence[float]) -> Array:
    """Density above which lie the given probabilities."""
    order = np.argsort(density)[::-1]
    order = order[np.isfinite(density[order])]
    cumulative = np.cumsum(mass[order]) / mass[order].sum()
    return density[order][np.searchsorted(cumulative, probs)]


def _contours(
    da: xr.DataArray,
    target: Any,
    *,
    kind: Literal["contour", "contourf"],
    x: xr.DataArray,
    y: xr.DataArray,
    level: xr.DataArray,
    peak: xr.DataArray,
    **settings: Any,
) -> NDArray[np.object_]:
    """Draw one contour, or the area inside it, for each level that the density reaches here."""
    from arviz_plots.plot_collection import backend_from_object

    draw = getattr(backend_from_object(target), kind)
    artists = np.full(level.size, None, dtype=object)
    for i, threshold in enumerate(level.values.tolist()):
        if float(da.max()) > threshold:
            levels = [threshold, float(peak)] if kind == "contourf" else [threshold]
            artists[i] = draw(x.values, y.values, da.values, target, levels=levels, **settings)
    return artists


# What is drawn of classifications.


def _rows(results: dict[str, xr.Dataset]) -> tuple[str, list[str]]:
    """Dimension and headings of the rows, which all results must share."""
    found: list[tuple[str, list[str], list]] = []
    for name, result in results.items():
        if not isinstance(result, xr.Dataset):
            raise TypeError(
                "expected the result of ph.classify, an xarray.Dataset, not "
                f"{type(result).__name__}"
            )
        wanted = ("class_probability", "class_probability_se")
        lacking = [v for v in wanted if v not in result]
        if lacking or "class_label" not in result["class_probability"].dims:
            raise ValueError(
                f"{name or 'the result'} lacks {lacking[0] if lacking else 'class_label'!r}; "
                "it comes from ph.classify"
            )
        row = next(str(d) for d in result["class_probability"].dims if d != "class_label")
        classes = result["class_label"].values.tolist()
        found.append(
            (row, [_heading(result, row, i, classes) for i in range(result.sizes[row])], classes)
        )
    if any(other != found[0] for other in found):
        raise ValueError("the results differ in their experiments or classes; plot them apart")
    row, headings, _ = found[0]
    if len(set(headings)) < len(headings):
        headings = [f"{i}: {heading}" for i, heading in enumerate(headings, 1)]
    return row, headings


def _heading(result: xr.Dataset, row: str, i: int, classes: list[str]) -> str:
    def label(name: str) -> Any:
        return result[name].values.tolist()[i] if name in result.coords else None

    heading = str(label("specimen") or f"{row} {i + 1}")
    if label("experiment") is not None:
        heading += f", experiment {label('experiment')}"
    if label("group") in classes:
        heading += f" (true class {label('group')})"
    return heading


def _number(probability: float) -> str:
    if probability < 0.0005:
        return "<0.001"
    return ">0.999" if probability > 0.9995 else f"{probability:.3f}"


def _probability_ticks(da: xr.DataArray, target: Any) -> None:
    from arviz_plots.plot_collection import backend_from_object

    backend_from_object(target).yticks([0, 0.5, 1], ["0", "0.5", "1"], target)
