"""Elements of all figures: colours, the settings of the user, panels, legends and titles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from textwrap import fill
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.evidence.results import check_result
from pymc_hyperelastic.evidence.stored import check_numbers, damaged, is_said, read_draws
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.settings import law_names_of
from pymc_hyperelastic.rounding import rounded

# arviz_plots brings matplotlib along: it is imported when the first figure is drawn.
if TYPE_CHECKING:
    from arviz_plots import PlotCollection

Backend = Literal["matplotlib", "none"]
Visuals = Mapping[str, Mapping[str, Any] | bool]
# Settings of the user of a figure: backend, visuals, and arguments of the PlotCollection.
Wishes = tuple[Backend, Visuals | None, dict[str, Any]]

# Okabe and Ito's palette, which differs with any colour vision and in grey; without the yellow.
PALETTE = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000"]
# Styles of the second and third round of colours. Dashes mean extrapolation.
LINE_STYLES = ["-", "-.", ":"]
MARKERS = ["o", "^", "s", "d", "x", "+", "."]
# Colour of words that replace an answer, such as "undecided": none of the palette.
DOUBT = "#A00000"
# Inches that figures leave for a legend below their panels.
_BELOW = 0.35
# Columns of a legend at most.
_MOST_COLUMNS = 8
# Letters of a line of a legend: as many fit into the narrowest figure.
_LEGEND_WIDTH = 60
# Ratio of the ends of an axis of positive numbers from which it is logarithmic.
LOG_FROM = 10.0
# Steps of the ticks of a logarithmic axis in each decade, from wide to narrow.
_STEPS = [1], [1, 2, 5], [1, 1.5, 2, 3, 4, 5, 6, 8], np.arange(1, 10, 0.1), np.arange(1, 10, 0.02)
# Steps of the ticks of a narrow axis: those of 0.25 would have numbers that are longer.
_SHORT_STEPS = [1, 2, 5, 10]
# Ticks of a logarithmic axis.
_FEWEST_TICKS, _MOST_TICKS = 3, 7
# Errors of probabilities below this are not printed: three decimals do not show them.
_LEAST_ERROR = 0.0005


class Canvas:
    """A PlotCollection in the making, and what its user wants of it.

    `layout` makes the PlotCollection: the name of one of its constructors, or a function with the
    same arguments. `data` is what its panels are made for, `known` names the visuals of the figure
    between spaces, `size` is in inches, `share` states shared axes, and `settings` are those of the
    PlotCollection. Settings of the user replace these.
    """

    def __init__(
        self,
        layout: Literal["wrap", "grid"] | Callable[..., PlotCollection],
        data: xr.Dataset,
        known: str,
        wishes: Wishes,
        size: tuple[float, float],
        share: Mapping[str, Any],
        **settings: Any,
    ) -> None:
        from arviz_plots import PlotCollection

        backend, visuals, given = wishes
        if backend not in ("matplotlib", "none"):
            raise ValueError(f"backend must be 'matplotlib' or 'none', not {backend!r}")
        self.visuals = visuals or {}
        unknown = [name for name in self.visuals if name not in known.split()]
        if unknown:
            raise ValueError(f"no visual is called {unknown[0]!r}; there are {known.split()}")
        of_user = given.get("figure_kwargs", {})
        self._may_grow = "figsize" not in of_user
        figure = {"layout": "constrained", "figsize": size, **share} | of_user
        settings = {"color": PALETTE} | settings | given | {"figure_kwargs": figure}
        make = getattr(PlotCollection, layout) if isinstance(layout, str) else layout
        self.collection: PlotCollection = make(data, backend=backend, **settings)

    def wanted(self, name: str, settings: dict[str, Any]) -> dict[str, Any] | None:
        """Settings of a visual, the user's before ours; None if it is to be left out."""
        chosen = self.visuals.get(name, True)
        if chosen is False:
            return None
        return settings if chosen is True else settings | dict(chosen)

    def draw(self, name: str, function: str | Callable, **settings: Any) -> None:
        """Draw a visual in every panel by a function, or by one of ``arviz_plots.visuals``."""
        wanted = self.wanted(name, settings)
        if wanted is not None:
            self.collection.map(_visual(function), name, **wanted)

    def label(self, name: str, text: str, **settings: Any) -> None:
        """Write ``xlabel``, ``ylabel`` or ``title`` of panels."""
        # Titles of panels are labels of the data, and those of axes hold symbols.
        text = literal(text) if name == "title" else text
        function = f"labelled_{name.removesuffix('label')}"
        self.draw(name, function, text=text, ignore_aes="all", **settings)

    def adjust(self, function: str | Callable, **settings: Any) -> None:
        """Adjust panels, such as their limits."""
        self.collection.map(_visual(function), store_artist=False, ignore_aes="all", **settings)

    def entries(self, dim: str, prefix: str, *aesthetics: str, **settings: Any) -> dict[str, dict]:
        """Legend entries of the labels of `dim`, if several: they differ by these aesthetics."""
        mappings = {key: self.collection.aes[key]["mapping"] for key in aesthetics}
        labels = mappings[aesthetics[0]][dim].values.tolist()
        if len(labels) == 1:
            return {}
        return {
            f"{prefix}{literal(label)}": settings
            | {key: mapping.sel({dim: label}).item() for key, mapping in mappings.items()}
            for label in labels
        }

    def legend(self, entries: dict[str, dict]) -> None:
        """Add a legend below the panels, all of it, unless it would have one entry.

        The figure grows by the height of a legend that has more than one row.
        """
        settings = {"frameon": False, "fontsize": "small", "loc": "outside lower center"}
        wanted = self.wanted("legend", settings)
        if wanted is None or len(entries) < 2:
            return
        backend = import_module(f"arviz_plots.backend.{self.collection.backend}")
        labels = [fill(label, _LEGEND_WIDTH) for label in entries]
        draw = partial(backend.legend, self.collection, [*entries.values()], labels)
        if self.collection.backend == "none":
            draw(**wanted)
            return
        figure = self.collection.get_viz("figure")
        width, height = figure.get_size_inches()
        for columns in range(min(len(entries), _MOST_COLUMNS), 0, -1):
            legend = draw(**{"ncols": columns} | wanted)
            extent = legend.get_window_extent(figure.canvas.get_renderer())
            if extent.width <= width * figure.dpi or columns == 1:
                break
            legend.remove()
        if self._may_grow:
            figure.set_size_inches(width, height + max(extent.height / figure.dpi - _BELOW, 0))

    def title(self, attrs: Sequence[Mapping[Any, Any]], *before: str | None) -> None:
        """Name the content and its data in the title; simulated data are called so."""
        titles = dict.fromkeys(str(a["title"]) for a in attrs if is_said(a.get("title")))
        text = ", ".join([*filter(None, before), *titles])
        if any(is_said(a.get("simulated")) for a in attrs) and "simulated" not in text.lower():
            text = f"{text}, SIMULATED data" if text else "SIMULATED data"
        if text:
            self.collection.add_title(literal(text), size="medium", wrap=True)


def _visual(function: str | Callable) -> Callable:
    """The function of ``arviz_plots.visuals`` that has this name; another one as it is."""
    visuals = import_module("arviz_plots.visuals")
    return getattr(visuals, function) if isinstance(function, str) else function


def literal(text: object) -> str:
    r"""Text that a figure shows as it is: matplotlib would typeset what stands between two $.

    Examples
    --------
    >>> print(literal("5 $ to 7 $"))
    5 \$ to 7 \$
    """
    return str(text).replace("$", r"\$")


def many_looks() -> dict[str, Any]:
    """Colours, line styles and markers of many labels, each of which looks different."""
    return {
        "color": PALETTE * len(MARKERS),
        "linestyle": [style for style in LINE_STYLES for _ in PALETTE],
        "marker": [marker for marker in MARKERS for _ in PALETTE],
    }


def check_table(result: Any, origin: str, *names: str) -> None:
    """Raise unless this is a Dataset with such variables."""
    if not isinstance(result, xr.Dataset):
        raise TypeError(
            f"expected the result of {origin}, an xarray.Dataset, not {type(result).__name__}"
        )
    for name in names:
        if name not in result.variables:
            raise ValueError(f"the result lacks {name!r}; it comes from {origin}")
        if name in result.data_vars:
            check_numbers(result, result, name, None, finite=False)
        elif not result[name].ndim:
            raise damaged(result, f"{name!r} has no dimension")


def stacked(name: str, **arrays: xr.DataArray) -> xr.Dataset:
    """The coordinates of something to draw, along the dimension that visuals read."""
    broadcast = xr.broadcast(*(a.reset_coords(drop=True).astype(float) for a in arrays.values()))
    coordinates = xr.concat(broadcast, dim="plot_axis").assign_coords(plot_axis=list(arrays))
    return coordinates.to_dataset(name=name)


def set_yticks(da: xr.DataArray, target: Any, *, values: list[float], labels: list[str]) -> None:
    """Name places on a vertical axis, which no visual of arviz_plots does."""
    from arviz_plots.plot_collection import backend_from_object

    backend_from_object(target).yticks(values, labels, target)


def ticks_on_the_right(da: xr.DataArray, target: Any) -> None:
    """Move the ticks of a vertical axis to the right of its panel."""
    if hasattr(target, "yaxis"):
        target.yaxis.tick_right()


def few_ticks(da: xr.DataArray, target: Any, *, intervals: int) -> None:
    """Divide a horizontal axis into few intervals, so that the numbers do not touch."""
    if hasattr(target, "xaxis"):
        from matplotlib.ticker import MaxNLocator

        target.xaxis.set_major_locator(MaxNLocator(intervals, steps=_SHORT_STEPS))


def log_axis(
    da: xr.DataArray, target: Any, *, ends: tuple[float, float], axis: Literal["x", "y"] = "y"
) -> None:
    """Make an axis logarithmic, with ticks at round numbers between its ends."""
    from arviz_plots.plot_collection import backend_from_object

    backend, values = backend_from_object(target), log_ticks(*ends)
    getattr(backend, f"{axis}scale")(target, "log")
    getattr(backend, f"{axis}ticks")(values, [f"{value:g}" for value in values], target)
    if hasattr(target, "minorticks_off"):
        target.minorticks_off()


def log_ticks(low: float, high: float) -> list[float]:
    """Round numbers between two ends of a logarithmic axis, 3 to 7 of them.

    Examples
    --------
    >>> log_ticks(0.45, 2.3), log_ticks(0.8, 40.0)
    ([0.5, 1.0, 2.0], [1.0, 2.0, 5.0, 10.0, 20.0])
    """
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    for steps in _STEPS:
        values = np.outer(decades, steps).ravel()
        values = values[(values >= low) & (values <= high)]
        if len(values) >= _FEWEST_TICKS:
            break
    return values[:: max(1, -(-len(values) // _MOST_TICKS))].tolist()


def per_kilopascal(pressure_unit: str) -> float:
    """How many of the unit make 1 kPa."""
    return 1 / float(to_internal(1.0, pressure_unit, "pressure"))


def rounded_probability(probability: float, error: float = 0.0) -> str:
    """A probability as it is printed, never as exactly zero or one unless its error says so."""
    if error >= _LEAST_ERROR:
        return " ± ".join(rounded([probability, error], error))
    if probability < 0.0005:
        return "<0.001"
    return ">0.999" if probability > 0.9995 else f"{probability:.3f}"


def fitted_classes(classes: xr.DataTree) -> dict[str, xr.DataTree]:
    """Sampled models by class; a single one has the name of its group."""
    check_result(classes, "ph.fit_classes or ph.sample_smc")
    if "posterior" in classes.children:
        read_draws(classes, "posterior")
        return {classes.name or "posterior": classes}
    fitted = {str(n): tree for n, tree in classes.children.items() if "posterior" in tree.children}
    if not fitted:
        raise ValueError(
            "the result holds no posterior; it comes from ph.fit_classes or ph.sample_smc"
        )
    for tree in classes.children.values():
        # A class that lacks its posterior is not left out in silence.
        if {"posterior", "evidence", "constant_data"} & set(tree.children):
            read_draws(tree, "posterior")
    return fitted


def law_of(tree: xr.DataTree, energy: Any = None) -> str | None:
    """Name of the material, which may be given, or those of the layers."""
    if isinstance(energy, StrainEnergy):
        return energy.name
    return " in ".join(law_names_of(tree)) or None


def training_attrs(fitted: Mapping[str, xr.DataTree]) -> list[Mapping[Any, Any]]:
    """Attributes of the data to which the classes were fitted."""
    return [t["constant_data"].attrs for t in fitted.values() if "constant_data" in t.children]
