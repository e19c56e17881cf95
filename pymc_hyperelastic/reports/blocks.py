"""What a report is made of: notices, texts, tables and figures in chapters."""

import io
import math
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import xarray as xr

from pymc_hyperelastic.plots.style import rounded_probability
from pymc_hyperelastic.reports.svg import inline_svg

# How notices are called, from the worst.
LEVELS = ("not to be trusted", "caution", "note")
BAD, CAUTION, NOTE = LEVELS
# Points of a figure from which on they are drawn as pixels: as shapes they would make it heavy.
_MOST_SHAPES = 6000
# Names that a sentence takes.
_MOST_NAMED = 20


class Notice(NamedTuple):
    """Something that a reader has to know before the numbers."""

    level: str
    text: str


class Text(NamedTuple):
    """A paragraph."""

    text: str
    kind: str = "text"


class Table(NamedTuple):
    """Rows of texts and numbers, the first of each names it."""

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    kind: str = "table"


class Figure(NamedTuple):
    """A drawing, as SVG, and its caption."""

    svg: str
    caption: str
    kind: str = "figure"


type Block = Text | Table | Figure


class Found(NamedTuple):
    """One of the results that a report is of, under its title."""

    title: str
    result: Any


@dataclass
class Page:
    """A report in the making: what has been found out on the way, and how many figures it has."""

    pressure: Any = None
    pressure_unit: str = "mmHg"
    notices: list[Notice] = field(default_factory=list)
    checked: list[str] = field(default_factory=list)
    complete: bool = True
    """Whether all fits of the page were compared with their data."""
    shown: list[Any] = field(default_factory=list)
    """Data that stand on the page already."""
    figures: int = 0

    def notice(self, level: str, text: str) -> None:
        """Add a notice, once."""
        if Notice(level, text) not in self.notices:
            self.notices.append(Notice(level, text))

    def check(self, what: str) -> None:
        """Say, once, what has been looked at."""
        if what not in self.checked:
            self.checked.append(what)

    @contextmanager
    def listening(self, what: str, aloud: bool = True) -> Iterator[None]:
        """Turn errors that the data are the cause of, and warnings if `aloud`, into notices."""
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            try:
                yield
            except (ValueError, TypeError, ArithmeticError) as error:
                self.notice(CAUTION, f"{what} cannot be shown: {error}")
        for warning in heard if aloud else ():
            # Other fonts than matplotlib's have the letter.
            if issubclass(warning.category, UserWarning) and "Glyph" not in str(warning.message):
                self.notice(CAUTION, f"{what}: {warning.message}")

    def figure(
        self,
        draw: Callable[..., Any],
        *args: Any,
        label: str,
        caption: str,
        aloud: bool = True,
        **settings: Any,
    ) -> list[Block]:
        """Draw a figure; a list without it, and a notice, if that cannot be."""
        import matplotlib as mpl
        from matplotlib import pyplot as plt

        drawn: list[Block] = []
        # Text stays text: it can be found, copied, and read in any alphabet.
        style: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": "report"}
        # What shows the figures of a notebook is set up now: below it would be undone again.
        plt.draw_if_interactive()
        with self.listening(f"The figure “{label}”", aloud), mpl.rc_context(style), plt.ioff():
            before = set(plt.get_fignums())
            try:
                figure = draw(*args, **settings).get_viz("figure")
                _thin(figure)
                file = io.StringIO()
                nothing = {"Date": None, "Creator": None, "Format": None, "Type": None}
                figure.savefig(file, format="svg", transparent=True, metadata=nothing)
                self.figures += 1
                drawn.append(Figure(inline_svg(file.getvalue(), self.figures, label), caption))
            finally:
                for number in set(plt.get_fignums()) - before:
                    plt.close(number)
        return drawn


def _thin(figure: Any) -> None:
    """Draw points as pixels where they are very many."""
    clouds = [c for axes in figure.axes for c in axes.collections if len(c.get_offsets()) > 1]
    if sum(len(c.get_offsets()) for c in clouds) > _MOST_SHAPES:
        for cloud in clouds:
            cloud.set_rasterized(True)


def is_table(result: Any, *names: str) -> bool:
    """Whether a result is one Dataset, with such variables."""
    return isinstance(result, xr.Dataset) and set(names) <= set(result.variables)


class Probability(float):
    """A number that a table never shows as exactly zero or one."""


def short(value: float) -> str:
    """A number as a table shows it.

    >>> short(-1234.5678), short(0.00001234), short(float("inf")), short(float("nan"))
    ('−1235', '1.234 × 10⁻⁵', 'infinite', 'not known')
    >>> short(Probability(1.0))
    '>0.999'
    """
    if math.isnan(value):
        return "not known"
    if isinstance(value, Probability):
        return rounded_probability(value)
    if math.isinf(value):
        return "infinite" if value > 0 else "−infinite"
    text = f"{value:.4g}"
    if power := re.fullmatch(r"(.*)e([+-])0*(\d+)", text):
        digits = power[3].translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))
        text = f"{power[1]} × 10{'⁻' if power[2] == '-' else ''}{digits}"
    return text.replace("-", "−")


def plural(count: int, one: str, many: str = "") -> str:
    """A count with its noun.

    >>> plural(1, "specimen"), plural(2, "specimen"), plural(2, "axial stretch", "axial stretches")
    ('1 specimen', '2 specimens', '2 axial stretches')
    """
    return f"{count} {one if count == 1 else many or one + 's'}"


def in_words(items: Sequence[Any]) -> str:
    """A list as a sentence has it.

    >>> in_words(["a"]), in_words(["a", "b"]), in_words(["a", "b", "c"])
    ('a', 'a and b', 'a, b and c')
    """
    texts = [str(item) for item in items]
    return " and ".join([", ".join(texts[:-1]), texts[-1]] if texts[1:] else texts)


def some_in_words(items: Sequence[Any]) -> str:
    """A list as a sentence has it, of many items the first.

    >>> some_in_words("abc"), some_in_words(range(1000))[-21:]
    ('a, b and c', '18, 19 and 980 others')
    """
    few, left = list(items)[:_MOST_NAMED], len(items) - _MOST_NAMED
    return in_words([*few, plural(left, "other")] if left > 0 else few)
