"""The page of a report: findings, notices, texts, tables and figures, which the sections add."""

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

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.plots.style import rounded_probability
from pymc_hyperelastic.predictions.conditions import Conditions
from pymc_hyperelastic.rounding import rounded, rounded_interval, short

# Levels of a notice, from the worst.
LEVELS = ("not to be trusted", "caution", "note")
BAD, CAUTION, NOTE = LEVELS
# Points of a figure above which they are drawn as pixels: as shapes they would make a large file.
_MOST_SHAPES = 6000
# Characters that names may have, but no XML, and so no SVG.
_FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")
#: Probability of the intervals and bands of a report.
PROB = 0.95
#: Names or messages that a report lists at most.
MOST_LISTED = 20
#: Pressures of a curve that a table shows.
PRESSURES = 3
# Headings that the name of a variable does not give.
_HEADINGS = {
    "name": "specimen",
    "true_class": "true group",
    "strain_energy": "law",
    "pareto_k": "Pareto k",
    "log_evidence": "log evidence (nats)",
    "log_bayes_factor": "log Bayes factor (nats)",
    "freedom": "degrees of freedom",
    "probability_of_rise": "probability of a rise",
    "probability_of_difference": "probability of different distributions",
    "strain_energy_probability": "probability",
    "strain_energy_log_evidence": "log evidence (nats)",
    "standard_error": "standard error of the log evidence (nats)",
}
# Words in the headings of columns whose numbers are never shown as exactly 0 or 1.
_PROBABILITIES = re.compile("probability|p-value|share|decided|wrong|covered|accuracy")
# Texts of a cell that holds nothing. A column of such cells is left out.
_NOTHING = {"", "-", "unknown", "not known", "not stated"}


class Notice(NamedTuple):
    """A warning or note at the top of the page."""

    level: str
    words: str
    todo: str
    """Advice to the reader; empty if `words` hold it."""


class Interval(NamedTuple):
    """A cell of a table: a median with the ends of its interval."""

    value: float
    low: float
    high: float


def interval_of(draws: np.ndarray) -> Interval:
    """Return the median and the interval of finite draws; all are NaN without such a draw."""
    known = draws[np.isfinite(draws)]
    if not known.size:
        return Interval(np.nan, np.nan, np.nan)
    return Interval(*np.quantile(known, [0.5, (1 - PROB) / 2, (1 + PROB) / 2]).tolist())


@dataclass
class Page:
    """A report in the making."""

    at: Conditions = field(default_factory=Conditions)
    """Conditions for elastic properties, and the unit of pressures."""
    title: str = ""
    """Title of the result whose section is being written."""
    data: list[xr.Dataset] = field(default_factory=list)
    """Inflation data that are on the page already."""
    findings: list[str] = field(default_factory=list)
    """Sentences on the main results, for the summary."""
    values: list[str] = field(default_factory=list)
    """Sentences on single values: the first is in the summary if there is no finding."""
    least_certain: tuple[float, str] = (1.0, "")
    """Largest ratio of the ends of an interval, and a sentence on it."""
    notices: dict[Notice, list[str]] = field(default_factory=dict)
    """Subjects of each notice: results, or parts of them."""
    complete: bool = True
    """False if the residuals of a fit are unknown."""
    shown: set[str] = field(default_factory=set)
    """Descriptions of data that are on the page already."""
    methods: list[str] = field(default_factory=list)
    """Sentences of the paragraph on the methods."""
    blocks: list[dict[str, Any]] = field(default_factory=list)
    """Texts, tables and figures of the section."""

    def notice(self, level: str, words: str, todo: str = "", subject: str | None = None) -> None:
        """Add a notice about a subject, by default the result, and what the reader can do."""
        notice = Notice(level, words.rstrip("."), todo.rstrip("."))
        subjects = self.notices.setdefault(notice, [])
        if (subject or self.title) not in subjects:
            subjects.append(subject or self.title)

    def notice_where(
        self, level: str, words: str, todo: str, names: Any, where: Any, subject: str | None = None
    ) -> None:
        """Add a notice with the names where a condition holds."""
        chosen = np.asarray(names, object)[np.asarray(where)]
        if chosen.size:
            self.notice(level, f"{words}: {listed(chosen)}", todo, subject)

    @property
    def warnings(self) -> list[tuple[str, str, str]]:
        """Level, text, and what to do, of all notices, the most serious first."""
        said = [(n.level, f"{listed(of)}: {n.words}.", n.todo) for n, of in self.notices.items()]
        return sorted(said, key=lambda notice: LEVELS.index(notice[0]))

    def uncertain(self, interval: Interval, of_what: str, unit: str) -> None:
        """Note the interval of a positive quantity if no other one is wider, relative to it."""
        known = np.isfinite(interval).all() and interval.low > 0
        ratio = interval.high / interval.low if known else 1.0
        if ratio > self.least_certain[0]:
            self.least_certain = ratio, f"{of_what}: {in_words(interval)} {unit}"

    @contextmanager
    def catching(self, subject: str, shown: bool = True) -> Iterator[None]:
        """Turn errors caused by data into notices, and warnings too if they are to be shown."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                yield
            except (ValueError, TypeError, ArithmeticError) as error:
                self.notice(CAUTION, f"cannot be shown: {error}", "", subject)
        for warning in caught if shown else ():
            # The browser has fonts with the letters that matplotlib's font lacks.
            if issubclass(warning.category, UserWarning) and "Glyph" not in str(warning.message):
                self.notice(CAUTION, str(warning.message), "", subject)

    def text(self, text: str) -> None:
        """Add a paragraph."""
        self.blocks.append({"text": text})

    def table(self, what: str, frame: pd.DataFrame, note: str = "", keep: str = "") -> None:
        """Add a table, unless it is empty; the first column names the rows.

        Columns without content are left out. A text that is the same in all rows moves to the note,
        unless it is a unit, or in the column to `keep`.
        """
        columns = {str(n): [cell_of(str(n), v) for v in values] for n, values in frame.items()}
        same = []
        for name, cells in [*columns.items()][1:]:
            texts = {"".join(text for text, _ in cell) for cell in cells}
            is_text = all(number is None for cell in cells for _, number in cell)
            if texts <= _NOTHING:
                del columns[name]
            elif name not in (keep, "unit") and is_text and len(texts) == 1 < len(cells):
                same.append(f"{name}: {texts.pop()}")
                del columns[name]
        if same:
            note = f"{note} In all rows, {'; '.join(same)}.".lstrip()
        if len(frame):
            caption = f"{what}: {self.title}" if self.title else what
            rows = list(zip(*columns.values(), strict=True))
            table = {"caption": caption, "note": note, "columns": [*columns], "rows": rows}
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
                width = round(96 * figure.get_figwidth())  # CSS pixels per inch
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

    A variable with a standard error, ``"x"`` with ``"x_se"``, has an :class:`Estimate` in each
    cell; the name ``"x_interval"`` gives a column of :class:`Interval`.
    """
    columns: dict[str, Any] = {}
    places = xr.Dataset(
        coords={d: result[d] if d in result else range(result.sizes[d]) for d in dims}
    )

    def values_of(name: str, **at: str) -> Any:
        values = result[name].sel(at, drop=True) if at else result[name]
        return values.broadcast_like(places).transpose(*dims).values.ravel().tolist()

    for name in names.split():
        base = name.removesuffix("_interval")
        if base not in result.variables:
            continue
        heading = heading_of(base)
        if name != base:
            ends = [values_of(name, bound=bound) for bound in ("low", "high")]
            cells = [*map(Interval, values_of(base), *ends)]
            columns[f"{heading} ({percent(result.attrs['interval'])} interval)"] = cells
        elif f"{name}_se" in result:
            columns[heading] = [*map(Estimate, values_of(name), values_of(f"{name}_se"))]
        else:
            columns[heading] = values_of(name)
    frame = pd.DataFrame({name: pd.Series(cells, dtype=object) for name, cells in columns.items()})
    if "unit" in frame:
        frame["unit"] = frame["unit"].replace("1", "")
    return frame


def heading_of(name: str) -> str:
    """Return the heading of a column that holds a variable.

    >>> heading_of("pareto_k"), heading_of("best_accuracy")
    ('Pareto k', 'best accuracy')
    """
    return _HEADINGS.get(name, name.replace("_", " "))


def cell_of(heading: str, value: Any) -> list[tuple[str, float | None]]:
    """Return the texts of a cell of a table, each with its value if it is a number.

    >>> cell_of("probability of a rise", 1.0), cell_of("unit", "kPa")
    ([('>0.999', 1.0)], [('kPa', None)])
    >>> "".join(text for text, _ in cell_of("mean", Interval(-17.18, -18.2, -16.5)))
    '−17.18 (−18.20 to −16.50)'
    """
    probable = _PROBABILITIES.search(heading)
    if isinstance(value, Estimate | Interval) and math.isnan(value.value):
        value = math.nan
    if isinstance(value, Estimate):
        return _estimated(value, bool(probable))
    if isinstance(value, Interval):
        texts = rounded_interval(*value)
        parts = [*zip(texts, value, strict=True)]
        return [parts[0], (" (", None), parts[1], (" to ", None), parts[2], (")", None)]
    if isinstance(value, int | np.integer):
        return [(str(value), int(value))]
    if not isinstance(value, float):
        return [(str(value), None)]
    if probable and math.isfinite(value):
        return [(rounded_probability(value), value)]
    return [(short(value), value)]


def _estimated(estimate: Estimate, probable: bool) -> list[tuple[str, float | None]]:
    value, error = estimate
    # Probabilities have three decimals, which do not show a smaller error.
    if probable and rounded_probability(value)[0] in "<>" and round(error, 3) == 0:
        return [(rounded_probability(value), value)]
    first, second = rounded(estimate, error)
    return [(first, value), (" ± ", None), (second, error)]


def in_words(value: Any, heading: str = "") -> str:
    """Return the text of a number, an estimate or an interval, as in a table.

    >>> in_words(Interval(0.35087, 0.23522, 0.555)), in_words(Estimate(-17.1834, 0.0403))
    ('0.35 (0.24 to 0.56)', '−17.183 ± 0.040')
    """
    return "".join(text for text, _ in cell_of(heading, value))


def percent(share: float) -> str:
    """Return a probability in per cent.

    >>> percent(0.95), percent(0.999)
    ('95 %', '99.9 %')
    """
    return f"{100 * float(share):.3g} %"


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
    texts = [str(item) for item in items[:MOST_LISTED]]
    if len(items) > MOST_LISTED:
        texts.append(plural(len(items) - MOST_LISTED, "other"))
    return " and ".join([", ".join(texts[:-1]), texts[-1]] if texts[1:] else texts)
