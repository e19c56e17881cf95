"""Elements of all figures: colours, the settings of the user, panels, legends and titles."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from importlib import import_module
from textwrap import fill
from typing import TYPE_CHECKING, Any, Literal

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
# Ratio of the ends of an axis of positive numbers from which it is logarithmic.
LOG_FROM = 10.0


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
        self.backend = import_module(f"arviz_plots.backend.{backend}")

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

    def draw_xy(
        self, name: str, function: str, x: xr.DataArray, y: xr.DataArray, **settings: Any
    ) -> None:
        """Draw a visual of lines or points where both coordinates are known."""
        (variable,) = self.collection.data.data_vars
        self.draw(
            name, function, data=stacked(str(variable), x=x, y=y.where(x.notnull())), **settings
        )

    def label(self, name: str, text: str, **settings: Any) -> None:
        """Write ``xlabel``, ``ylabel`` or ``title`` of panels."""
        # Titles of panels are labels of the data, and those of axes hold symbols.
        text = literal(text) if name == "title" else text
        function = f"labelled_{name.removesuffix('label')}"
        self.draw(name, function, text=text, ignore_aes="all", **settings)

    def adjust(self, function: str | Callable, **settings: Any) -> None:
        """Adjust panels, such as their limits."""
        self.collection.map(_visual(function), store_artist=False, ignore_aes="all", **settings)

    def set_yticks(self, values: list[float], labels: list[str], **where: Any) -> None:
        """Name places on vertical axes, which no visual of arviz_plots does."""
        self.adjust(lambda da, target: self.backend.yticks(values, labels, target), **where)

    def end_at_0_and_1(self, **where: Any) -> None:
        """Let horizontal axes of probabilities end at 0 and 1."""
        self.adjust("set_xlim", limits=(0, 1), **where)
        self.adjust("set_xticks", values=[0, 0.5, 1], labels=["0", "0.5", "1"], **where)

    def on_axes(self, change: Callable[[Any], object], **where: Any) -> None:
        """Call a function of the axes of matplotlib, if it draws the figure."""
        if self.collection.backend == "matplotlib":
            self.adjust(lambda da, target: change(target), **where)

    def few_xticks(self, intervals: int) -> None:
        """Divide horizontal axes into few intervals, so that the numbers do not touch."""
        # Matplotlib's own steps have 2.5, whose multiples are longer numbers.
        settings = {"axis": "x", "nbins": intervals, "steps": [1, 2, 5, 10]}
        self.on_axes(lambda axes: axes.locator_params(**settings))

    def limit(self, axis: str, ends: tuple[float, float], log: bool, **where: Any) -> None:
        """Limit axis ``x`` or ``y``; if `log`, make it logarithmic with round numbers at ticks."""

        def set_ticks(axes: Any) -> None:
            from matplotlib.ticker import AutoLocator, LogLocator

            own, ratio = getattr(axes, f"{axis}axis"), ends[1] / ends[0]
            # Axes of three decades and more have ticks at powers of ten.
            steps = [1, 2, 5] if ratio < LOG_FROM**3 else [1]
            own.set_major_locator(LogLocator(subs=steps) if ratio > LOG_FROM else AutoLocator())
            own.set_major_formatter("{x:g}")
            axes.minorticks_off()

        if log:
            self.adjust(f"set_{axis}scale", scale="log", **where)
            self.on_axes(set_ticks, **where)
        self.adjust(f"set_{axis}lim", limits=ends, **where)

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
        labels = [fill(label, 60) for label in entries]  # as wide as the narrowest figure
        draw = partial(self.backend.legend, self.collection, [*entries.values()], labels)
        if self.collection.backend == "none":
            draw(**wanted)
            return
        figure = self.collection.get_viz("figure")
        width, height = figure.get_size_inches()
        for columns in range(min(len(entries), 8), 0, -1):
            legend = draw(**{"ncols": columns} | wanted)
            extent = legend.get_window_extent(figure.canvas.get_renderer())
            if extent.width <= width * figure.dpi or columns == 1:
                break
            legend.remove()
        if self._may_grow:
            # All sizes of figures have room for one row, of 0.35 inches.
            figure.set_size_inches(width, height + max(extent.height / figure.dpi - 0.35, 0))

    def title(self, attrs: Sequence[Mapping[Any, Any]], *before: str | None) -> None:
        """Name the content and its data in the title; simulated data are called so."""
        titles = dict.fromkeys(str(a["title"]) for a in attrs if is_said(a.get("title")))
        text = ", ".join([*filter(None, before), *titles])
        if any(is_said(a.get("simulated")) for a in attrs) and "simulated" not in text.lower():
            text = f"{text}, SIMULATED data" if text else "SIMULATED data"
        if text:
            self.collection.add_title(literal(text), size="medium", wrap=True)

    def title_of_fits(
        self, fitted: Mapping[str, xr.DataTree], energy: Any, *before: str | None
    ) -> None:
        """Name the law, the content and the training data in the title."""
        law = law_of(next(iter(fitted.values())), energy)
        self.title(training_attrs(fitted), law, *before)


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


def with_margin(low: float, high: float) -> tuple[float, float]:
    """Ends of an axis of such values, with the margins that matplotlib leaves by default."""
    margin = 0.05 * (high - low)
    return low - margin, high + margin


def inches_of(texts: Iterable[str]) -> float:
    """Width of the longest line of some texts: a letter is about 0.08 inches wide."""
    return 0.08 * max(len(line) for text in texts for line in [*text.splitlines(), ""])


def check_choice(name: str, given: object, known: Collection[str | None]) -> None:
    """Raise unless an argument is one of the known names."""
    if given not in known:
        raise ValueError(f"{name} must be one of {', '.join(map(str, known))}, not {given!r}")


def per_kilopascal(pressure_unit: str) -> float:
    """How many of the unit make 1 kPa."""
    return 1 / float(to_internal(1.0, pressure_unit, "pressure"))


def rounded_probability(probability: float, error: float = 0.0) -> str:
    """A probability as it is printed, never as exactly zero or one unless its error says so."""
    if round(error, 3) > 0:
        return " ± ".join(rounded([probability, error], error))
    text = f"{probability:.3f}"
    return {"0.000": "<0.001", "1.000": ">0.999"}.get(text, text)


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


def law_of(tree: xr.DataTree, energy: Any) -> str | None:
    """Name of the material, which may be given, or those of the layers."""
    if isinstance(energy, StrainEnergy):
        return energy.name
    return " in ".join(law_names_of(tree)) or None


def training_attrs(fitted: Mapping[str, xr.DataTree]) -> list[Mapping[Any, Any]]:
    """Attributes of the data to which the classes were fitted."""
    return [t["constant_data"].attrs for t in fitted.values() if "constant_data" in t.children]
