"""What planned tests are expected to tell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import xarray as xr

from pymc_hyperelastic.evidence.stored import check_numbers, read_number, read_text
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.style import (
    Backend,
    Canvas,
    Visuals,
    check_table,
    rows_of,
    stacked,
    tick_rows,
)

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_LABELS = {
    "information": "expected information (nats)",
    "difference": "less than the first (nats)",
}
_ORIGIN = "ph.expected_information"
_ROW = 0.32  # inches of a design


@one_thread
def plot_information(
    result: xr.Dataset,
    *,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot what planned tests are expected to tell, the one that tells most on top.

    On the left stands the expected information of each design; where it is about the class, a line
    tells all that there is to be told. On the right stands what a design lacks of the first, known
    better than by the errors of both, since the same specimens were tested in all. Lines are two
    standard errors to each side.

    Parameters
    ----------
    result : xarray.Dataset
        Result of :func:`pymc_hyperelastic.expected_information`.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``points``, ``error``, ``all`` (the line of all that there is) and ``xlabel``;
        False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.wrap`.

    Returns
    -------
    arviz_plots.PlotCollection
        With the dimensions ``panel`` ("information" and "difference") and ``design``.

    Raises
    ------
    TypeError, ValueError
        If `result` is none of :func:`~pymc_hyperelastic.expected_information`, or the backend or a
        visual is unknown.

    See Also
    --------
    expected_information

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> classes = ph.open_result("hierarchical.nc")  # saved from an example of fit_classes
    >>> designs = {"low": {"pressure": (10, 40)}, "high": {"pressure": (100, 140)}}
    >>> found = ph.expected_information(
    ...     classes, designs, pressure_unit="mmHg", specimens=20, draws=64, random_seed=1
    ... )
    >>> figure = ph.plot_information(found, backend="none")
    >>> figure.viz["points"]["information"].sizes["design"]
    2
    """
    from arviz_plots.visuals import line_xy, scatter_xy, set_ylim, vline

    check_table(result, _ORIGIN, *_LABELS, *(f"{name}_se" for name in _LABELS), "design")
    for name in _LABELS:
        for of_designs in (name, f"{name}_se"):
            check_numbers(result, result, of_designs, ("design",), finite=False)
    panel = xr.DataArray(list(_LABELS), dims="panel", name="panel")
    value, error = (
        xr.concat([result[name + end].reset_coords(drop=True) for name in _LABELS], panel)
        for end in ("", "_se")
    )
    names = [str(name) for name in result["design"].values.tolist()]
    canvas = Canvas(
        "wrap",
        value.to_dataset(name="information"),
        "points error all xlabel",
        backend,
        visuals,
        pc_kwargs,
        {
            "figsize": (6.2 + 0.075 * max(map(len, names)), _ROW * len(names) + 1.3),
            "sharey": True,
        },
        cols=["panel"],
        col_wrap=2,
        aes={"color": ["design"], "overlay": ["design"]},
    )
    # All that there is to be told of a quantity has no end.
    about, law = read_text(result, "about"), read_text(result, "strain_energy")
    most = read_number(result, "entropy") if about == "class" else float("nan")
    lines = xr.DataArray([most, 0.0], {"panel": list(_LABELS)}, "panel").to_dataset(
        name="information"
    )
    canvas.draw("all", vline, data=lines, ignore_aes="all", color="0.6", width=0.8)
    y = rows_of("design", len(names))
    ends = xr.concat([value - 2 * error, value + 2 * error], dim="end")
    lines = stacked("information", x=ends, y=y)
    plain = {"ignore_aes": {"color"}, "color": "0.1"}
    canvas.draw("error", line_xy, data=lines, width=1.4, **plain)
    points = stacked("information", x=value, y=y)
    canvas.draw("points", scatter_xy, data=points, size=26, **plain)
    canvas.adjust(set_ylim, limits=(0.6 - len(names), 0.6))
    canvas.adjust(tick_rows, labels=names, coords={"panel": "information"})
    for name, text in _LABELS.items():
        canvas.label("xlabel", text, coords={"panel": name})
    told_of = "the class of a specimen" if about == "class" else f"its {about.replace('_', ' ')}"
    canvas.title([result.attrs], law, f"information about {told_of}")
    return canvas.collection
