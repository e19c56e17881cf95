"""What the figures share: colours, settings, labels, legends, titles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import extension_tests, held_stretches, points_of
from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.evidence.results import check_result
from pymc_hyperelastic.files.stored import check_numbers, damaged, is_said, read_draws
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.records import law_names_of
from pymc_hyperelastic.quantities import QUANTITIES

# arviz_plots brings matplotlib along: it is imported when the first figure is drawn.
if TYPE_CHECKING:
    from arviz_plots import PlotCollection

Backend = Literal["matplotlib", "none"]
Visuals = Mapping[str, Mapping[str, Any] | bool]

# Okabe and Ito's palette, told apart with any colour vision and in grey; the yellow is left out.
PALETTE = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000"]
# Where colours run out, they come again with the next of these. Dashes mean extrapolation.
LINE_STYLES = ["-", "-.", ":"]
MARKERS = ["o", "^", "s", "d", "x", "+", "."]
DOUBT = "#D55E00"  # of what is said in place of an answer
MOST_DRAWS = 2000  # of a class in one figure: more change no line visibly
RADIUS_LABEL = QUANTITIES["radius"].label
DIAMETER_LABEL = QUANTITIES["outer_diameter"].label
STRETCH_LABEL = QUANTITIES["axial_stretch"].label
# How the label of a stretch that varies begins; the part by which a pressure that is held varies.
_VARIED, _HELD = "varied at", 0.5
# Inches that figures leave for a legend beside and below their panels.
_BESIDE, _BELOW = 1.2, 0.35


class Canvas:
    """A PlotCollection in the making, and what its user wants of it.

    `layout` is a constructor of the PlotCollection, `data` what its panels are made for, `known`
    names the visuals of the figure between spaces, and `given` are the user's settings of the
    PlotCollection, which go before those in `figure` and `settings`.
    """

    def __init__(
        self,
        layout: Literal["wrap", "grid"],
        data: xr.Dataset,
        known: str,
        backend: str,
        visuals: Visuals | None,
        given: dict[str, Any],
        figure: dict[str, Any],
        **settings: Any,
    ) -> None:
        from arviz_plots import PlotCollection

        if backend not in ("matplotlib", "none"):
            raise ValueError(f"backend must be 'matplotlib' or 'none', not {backend!r}")
        self.visuals = visuals or {}
        unknown = [name for name in self.visuals if name not in known.split()]
        if unknown:
            raise ValueError(f"no visual is called {unknown[0]!r}; there are {known.split()}")
        figure = {"layout": "constrained"} | figure | given.get("figure_kwargs", {})
        # Whoever asks for a size gets it.
        self._may_grow = "figsize" not in given.get("figure_kwargs", {})
        settings = {"color": PALETTE} | settings | given | {"figure_kwargs": figure}
        self.collection: PlotCollection = getattr(PlotCollection, layout)(
            data, backend=backend, **settings
        )

    def wanted(self, name: str, settings: dict[str, Any]) -> dict[str, Any] | None:
        """Settings of a visual, the user's before ours; None if it is to be left out."""
        chosen = self.visuals.get(name, True)
        if chosen is False:
            return None
        return settings if chosen is True else settings | dict(chosen)

    def draw(self, name: str, function: Callable, **settings: Any) -> None:
        """Draw a visual in every panel."""
        wanted = self.wanted(name, settings)
        if wanted is not None:
            self.collection.map(function, name, **wanted)

    def label(self, name: str, text: str, **settings: Any) -> None:
        """Write ``xlabel``, ``ylabel`` or ``title`` of panels."""
        from arviz_plots import visuals

        functions = {
            "xlabel": visuals.labelled_x,
            "ylabel": visuals.labelled_y,
            "title": visuals.labelled_title,
        }
        # Titles of panels are labels of the data, and those of axes hold symbols.
        text = literal(text) if name == "title" else text
        self.draw(name, functions[name], text=text, ignore_aes="all", **settings)

    def adjust(self, function: Callable, **settings: Any) -> None:
        """Adjust panels, such as their limits."""
        self.collection.map(function, store_artist=False, ignore_aes="all", **settings)

    def entries(self, dim: str, prefix: str, *aesthetics: str, **settings: Any) -> dict[str, dict]:
        """Legend entries of the values of `dim`, which these aesthetics tell apart."""
        mappings = {key: self.collection.aes[key]["mapping"] for key in aesthetics}
        labels = mappings[aesthetics[0]][dim].values.tolist()
        return {
            f"{prefix}{literal(label)}": settings
            | {key: mapping.sel({dim: label}).item() for key, mapping in mappings.items()}
            for label in labels
        }

    def legend(self, entries: dict[str, dict], **settings: Any) -> None:
        """Add a legend beside or below the panels, all of it, unless it would have one entry."""
        settings = {"frameon": False, "fontsize": "small", "loc": "outside center right"} | settings
        wanted = self.wanted("legend", settings)
        if wanted is None or len(entries) < 2:
            return
        backend = import_module(f"arviz_plots.backend.{self.collection.backend}")

        def draw(columns: int) -> Any:
            several = {"ncols": columns} | wanted
            return backend.legend(self.collection, [*entries.values()], [*entries], **several)

        if self.collection.backend == "none":
            draw(1)
        else:
            _fit(self.collection.get_viz("figure"), draw, len(entries), self._may_grow)

    def title(self, attrs: Sequence[Mapping[Any, Any]], *before: str | None) -> None:
        """Say what is shown, and of which data; simulated data are called so."""
        titles = dict.fromkeys(str(a["title"]) for a in attrs if is_said(a.get("title")))
        text = ", ".join([*filter(None, before), *titles])
        if any(is_said(a.get("simulated")) for a in attrs) and "simulated" not in text.lower():
            text = f"{text}, SIMULATED data" if text else "SIMULATED data"
        if text:
            self.collection.add_title(literal(text), size="medium", wrap=True)


def _fit(figure: Any, draw: Callable[[int], Any], entries: int, may_grow: bool) -> None:
    """Draw a legend in columns: beside the panels no higher, below them no wider than the figure.

    If it may, the figure grows by what the legend takes more than it has been left.
    """

    def drawn(columns: int) -> tuple[Any, float, float]:
        legend = draw(columns)
        size = legend.get_window_extent(figure.canvas.get_renderer()).size / figure.dpi
        return legend, *size.tolist()

    width, height = figure.get_size_inches()
    legend, wide, high = drawn(1)
    beside = legend._outside_loc in ("left", "right")
    for columns in range(2, entries + 1):
        if beside and high <= height:
            break
        legend.remove()
        legend, next_wide, next_high = drawn(columns)
        if not beside and next_wide > 0.98 * width:
            legend.remove()
            legend, *_ = drawn(columns - 1)
            break
        wide, high = next_wide, next_high
    if may_grow:
        more = (max(wide - _BESIDE, 0), 0) if beside else (0, max(high - _BELOW, 0))
        figure.set_size_inches(width + more[0], height + more[1])


def literal(text: object) -> str:
    r"""Text that a figure shows as it is: matplotlib would typeset what stands between two $.

    Examples
    --------
    >>> print(literal("5 $ to 7 $"))
    5 \$ to 7 \$
    """
    return str(text).replace("$", r"\$")


def told_apart() -> dict[str, list[str]]:
    """Colour, line style and marker of things that one figure tells apart, however many."""
    count = len(PALETTE)
    return {
        "color": PALETTE * len(MARKERS),
        "linestyle": [s for s in LINE_STYLES for _ in range(count)],
        "marker": [m for m in MARKERS for _ in range(count)],
    }


def stretch_labels(data: xr.Dataset, pressure_unit: str = "mmHg") -> list[str]:
    """Axial stretches of tests as figures name them; where they vary, at which pressure."""
    labels = [f"{s:.4g}" if np.isfinite(s) else "unknown" for s in held_stretches(data)]
    pressure = per_kilopascal(pressure_unit) * data["pressure"].values
    for test in np.flatnonzero(extension_tests(data)):
        own = pressure[points_of(data, int(test))]
        low, high, mean = (_short(f(own)) for f in (np.min, np.max, np.mean))
        held = np.ptp(own) <= _HELD * np.abs(own).max()
        labels[test] = f"{_VARIED} {mean if held else f'{low} to {high}'} {pressure_unit}"
    return labels


def by_stretch(label: str) -> tuple[int, float]:
    """Where the label of an axial stretch stands among others: those that vary after those held."""
    if label.startswith(_VARIED):
        return 1, float(label.removeprefix(_VARIED).split()[0])
    return (2, 0.0) if label == "unknown" else (0, float(label))


def _short(pressure: float) -> str:
    return f"{pressure:.0f}" if abs(pressure) >= 10 else f"{pressure:.2g}"


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


def rows_of(dim: str, count: int) -> xr.DataArray:
    """Heights of so many rows, the first on top."""
    return xr.DataArray(-np.arange(float(count)), dims=dim)


def tick_rows(da: xr.DataArray, target: Any, *, labels: list[str]) -> None:
    """Name the rows of a panel."""
    from arviz_plots.plot_collection import backend_from_object

    rows = [-i for i in range(len(labels))]
    backend_from_object(target).yticks(rows, [*map(literal, labels)], target)


def per_kilopascal(pressure_unit: str) -> float:
    """How many of the unit make 1 kPa."""
    return 1 / float(to_internal(1.0, pressure_unit, "pressure"))


def rounded_probability(probability: float, error: float = 0.0) -> str:
    """A probability as it is printed, never as exactly zero or one unless its error says so."""
    if error >= 0.0005:
        return f"{probability:.3f} ± {error:.3f}"
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
        # A class that lacks it is not left out in silence.
        if {"posterior", "evidence", "constant_data"} & set(tree.children):
            read_draws(tree, "posterior")
    return fitted


def median_and_band(prob: float) -> list[float]:
    """Quantiles of a posterior curve: its median, and the ends of a band with equal tails."""
    return [0.5, (1 - prob) / 2, (1 + prob) / 2]


def solid_and_dashed(posterior: xr.Dataset, along: str) -> tuple[xr.Dataset, xr.Dataset]:
    """The median where it is measured, and where it is extrapolated; which reaches the first."""
    line = posterior.sel(plot_axis=["x", "y"])
    beyond = posterior.sel(plot_axis="extrapolated", drop=True)
    next_to = beyond.rolling({along: 3}, center=True, min_periods=1).max()
    return line.where(beyond != 1), line.where(next_to == 1)


def law_of(tree: xr.DataTree, energy: Any = None) -> str | None:
    """Name of the material, which may be given, or those of the layers."""
    if isinstance(energy, StrainEnergy):
        return energy.name
    return " in ".join(law_names_of(tree)) or None


def training_attrs(fitted: Mapping[str, xr.DataTree]) -> list[Mapping[Any, Any]]:
    """What is said of the data to which the classes were fitted."""
    return [t["constant_data"].attrs for t in fitted.values() if "constant_data" in t.children]
