"""The page of a report: notices, texts, tables and figures, which the sections of results add."""

import base64
import io
import math
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.plots.style import rounded_probability
from pymc_hyperelastic.predictions.conditions import Conditions

# Levels of a notice, from the worst.
LEVELS = ("not to be trusted", "caution", "note")
BAD, CAUTION, NOTE = LEVELS
# Points of a figure above which they are drawn as pixels: as shapes they would make a large file.
_MOST_SHAPES = 6000
# Characters that names may have, but no XML, and so no SVG.
_FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")
# CSS pixels per inch.
_PIXELS = 96
# Names that one sentence lists at most.
_MOST_NAMES = 20
# Headings that the name of a variable does not give.
_HEADINGS = {
    "name": "specimen",
    "class_label": "class",
    "pareto_k": "Pareto k",
    "p_value": "p-value",
    "log_bayes_factor": "log Bayes factor",
    "freedom": "degrees of freedom",
}
# Words in the headings of columns whose numbers are never shown as exactly 0 or 1.
_PROBABILITIES = re.compile("^(?!SE ).*(probability|p-value|share|decided|wrong|covered)")


class Notice(NamedTuple):
    """A warning or note at the top of the page."""

    level: str
    text: str


@dataclass
class Page:
    """A report in the making."""

    at: Conditions = field(default_factory=Conditions)
    """Conditions for elastic properties, and the unit of pressures."""
    title: str = ""
    """Title of the result whose section is being written."""
    notices: list[Notice] = field(default_factory=list)
    complete: bool = True
    """False if the residuals of a fit are unknown."""
    shown: list[Any] = field(default_factory=list)
    """Data and descriptions that are on the page already."""
    methods: list[str] = field(default_factory=list)
    """Sentences of the paragraph on the methods."""
    blocks: list[dict[str, Any]] = field(default_factory=list)
    """Texts, tables and figures of the section."""

    def notice(self, level: str, words: str, subject: str | None = None) -> None:
        """Add a notice about a subject, by default the result; the same notice only once."""
        notice = Notice(level, f"{subject or self.title}: {words.rstrip('.')}.")
        if notice not in self.notices:
            self.notices.append(notice)

    def notice_where(self, level: str, words: str, names: Any, where: Any, *subject: str) -> None:
        """Add a notice with the names where a condition holds."""
        chosen = np.asarray(names, object)[np.asarray(where)]
        if chosen.size:
            self.notice(level, f"{words}: {listed(chosen)}", *subject)

    @contextmanager
    def catching(self, subject: str, shown: bool = True) -> Iterator[None]:
        """Turn errors caused by data into notices, and warnings too if they are to be shown."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                yield
            except (ValueError, TypeError, ArithmeticError) as error:
                self.notice(CAUTION, f"cannot be shown: {error}", subject)
        for warning in caught if shown else ():
            # The browser has fonts with the letters that matplotlib's font lacks.
            if issubclass(warning.category, UserWarning) and "Glyph" not in str(warning.message):
                self.notice(CAUTION, str(warning.message), subject)

    def text(self, text: str) -> None:
        """Add a paragraph."""
        self.blocks.append({"text": text})

    def table(self, what: str, frame: pd.DataFrame, note: str = "") -> None:
        """Add a table, unless it is empty; the first column names the rows."""
        columns = [[cell_of(str(name), v) for v in values] for name, values in frame.items()]
        rows = list(zip(*columns, strict=True))
        if rows:
            caption = f"{what}: {self.title}"
            table = {"caption": caption, "note": note, "columns": [*frame.columns], "rows": rows}
            self.blocks.append(table)

    def figure(
        self,
        what: str,
        draw: Callable[..., Any],
        *args: Any,
        note: str = "",
        warned: bool = True,
        **settings: Any,
    ) -> None:
        """Add a figure, or a notice if it cannot be drawn."""
        import matplotlib as mpl
        from matplotlib import pyplot as plt

        # Text stays text, so that the browser finds letters of all alphabets.
        style: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": "report"}
        # A notebook's display of figures is initialised now: later it would undo the style.
        plt.draw_if_interactive()
        label = f"{what}: {self.title}"
        with self.catching(f"Figure “{label}”", warned), mpl.rc_context(style), plt.ioff():
            before = set(plt.get_fignums())
            try:
                figure = draw(*args, **settings).get_viz("figure")
                _simplify(figure)
                file = io.BytesIO()
                undated = {"Date": None, "Creator": None}
                figure.savefig(file, format="svg", transparent=True, metadata=undated)
                drawing = _FORBIDDEN.sub("\ufffd", file.getvalue().decode())
                image = base64.b64encode(drawing.encode()).decode()
                width = round(_PIXELS * figure.get_figwidth())
                self.blocks.append({"image": image, "caption": label, "note": note, "width": width})
            finally:
                for number in set(plt.get_fignums()) - before:
                    plt.close(number)


def _simplify(figure: Any) -> None:
    """Draw points as pixels if there are very many."""
    clouds = [c for axes in figure.axes for c in axes.collections if len(c.get_offsets()) > 1]
    if sum(len(c.get_offsets()) for c in clouds) > _MOST_SHAPES:
        for cloud in clouds:
            cloud.set_rasterized(True)


def frame_of(result: xr.Dataset, names: str, *dims: str) -> pd.DataFrame:
    """Return those of the named variables that are there, in columns; a row per entry along dims.

    An interval has a column for each end.
    """
    headings, variables = {}, {}
    for name in names.split():
        base = name.removesuffix("_se").removesuffix("_interval")
        heading = _HEADINGS.get(base) or base.replace("_", " ")
        if name.endswith("_interval"):
            ends = interval_ends(float(result.attrs["interval"]))
            for bound, end in zip(("low", "high"), ends, strict=True):
                headings[f"{name} {bound}"] = f"{heading}, {end}"
                variables[f"{name} {bound}"] = result[name].sel(bound=bound, drop=True)
        elif name in result.variables:
            headings[name] = f"SE of {heading}" if name.endswith("_se") else heading
            if name not in result.coords:
                variables[name] = result[name]
    frame = xr.Dataset(variables).to_dataframe(dim_order=list(dims)).reset_index()[[*headings]]
    if "unit" in frame:
        frame["unit"] = frame["unit"].replace("1", "")
    return frame.rename(columns=headings)


def cell_of(heading: str, value: Any) -> tuple[str, float | None]:
    """Text of a cell of a table, and its value if it is a number.

    >>> cell_of("probability of a rise", 1.0), cell_of("mean", -1234.5678), cell_of("unit", "kPa")
    (('>0.999', 1.0), ('−1235', -1234.5678), ('kPa', None))
    """
    if isinstance(value, int):
        return str(value), value
    if not isinstance(value, float):
        return str(value), None
    if _PROBABILITIES.match(heading) and math.isfinite(value):
        return rounded_probability(value), value
    return short(value), value


def short(value: float) -> str:
    """Four significant digits of a number.

    >>> short(-1234.5678), short(0.00001234), short(float("inf")), short(float("nan"))
    ('−1235', '1.234e−05', 'infinite', 'unknown')
    """
    text = "unknown" if math.isnan(value) else f"{value:.4g}"
    return text.replace("inf", "infinite").replace("-", "−")


def plural(count: int, noun: str) -> str:
    """Count with its noun.

    >>> plural(1, "specimen"), plural(2, "specimen")
    ('1 specimen', '2 specimens')
    """
    return f"{count} {noun if count == 1 else noun + 's'}"


def listed(items: Any) -> str:
    """Items as a sentence lists them; the first ones if there are many.

    >>> listed(["a"]), listed(["a", "b", "c"]), listed(range(1000))[-21:]
    ('a', 'a, b and c', '18, 19 and 980 others')
    """
    texts = [str(item) for item in items[:_MOST_NAMES]]
    if len(items) > _MOST_NAMES:
        texts.append(plural(len(items) - _MOST_NAMES, "other"))
    return " and ".join([", ".join(texts[:-1]), texts[-1]] if texts[1:] else texts)


def interval_ends(prob: float) -> list[str]:
    """Headings of the ends of an interval with equal tails.

    >>> interval_ends(0.95)
    ['2.5 %', '97.5 %']
    """
    return [f"{100 * q:.3g} %" for q in ((1 - prob) / 2, (1 + prob) / 2)]
