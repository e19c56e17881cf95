"""The expected information of planned tests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import xarray as xr

from pymc_hyperelastic.evidence.stored import check_numbers, read_number, read_text
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.rows import heights, joined, row_panels
from pymc_hyperelastic.plots.style import Backend, Visuals, check_table

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_PANELS = ("information", "difference")


@one_thread
def plot_information(
    result: xr.Dataset,
    *,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the expected information of planned tests, the largest on top.

    On the left stands the expected information of each design; where it is about the class, a grey
    line is the entropy of the class, the largest information possible. On the right stands its
    difference from that of the first design. The error of this difference is smaller than those of
    both, since the same specimens were tested in all designs. Lines are two standard errors to each
    side.

    Parameters
    ----------
    result : xarray.Dataset
        Result of :func:`pymc_hyperelastic.expected_information`.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``points``, ``error``,
        ``all`` (the line of all information) and ``xlabel``.

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
    >>> designs = {"low": {"pressure": (1, 5)}, "high": {"pressure": (13, 19)}}
    >>> found = ph.expected_information(classes, designs, specimens=20, draws=64, random_seed=2)
    >>> figure = ph.plot_information(found, backend="none")
    >>> figure.viz["points"]["information"].sizes["design"]
    2
    """
    columns = *_PANELS, *(f"{name}_se" for name in _PANELS)
    check_table(result, "ph.expected_information", *columns, "design")
    for column in columns:
        check_numbers(result, result, column, ("design",), finite=False)
    value, error = (
        result[[name + end for name in _PANELS]]
        .to_dataarray("panel")
        .assign_coords(panel=list(_PANELS))
        for end in ("", "_se")
    )
    names = [str(name) for name in result["design"].values.tolist()]
    data, aes = value.to_dataset(name="information"), {"color": ["design"], "overlay": ["design"]}
    wishes = backend, visuals, pc_kwargs
    canvas = row_panels(data, "points error all xlabel", wishes, names, 0.32, aes=aes)
    # Information about a quantity has no upper limit.
    about = read_text(result, "about")
    entropy = read_number(result, "entropy") if about == "class" else float("nan")
    limits = xr.DataArray([entropy, 0.0], {"panel": list(_PANELS)}, "panel")
    line = {"data": limits.to_dataset(name="information"), "color": "0.6", "width": 0.8}
    canvas.draw("all", "vline", ignore_aes="all", **line)
    y = heights("design", len(names))
    plain: dict[str, Any] = {"ignore_aes": {"color"}, "color": "0.1"}
    ends = joined(value - 2 * error, value + 2 * error)
    canvas.draw_xy("error", "line_xy", ends, y, width=1.3, **plain)
    canvas.draw_xy("points", "scatter_xy", value, y, size=22, **plain)
    subject = "the class of a specimen" if about == "class" else f"its {about.replace('_', ' ')}"
    law = read_text(result, "strain_energy")
    canvas.title([result.attrs], law, f"information about {subject}")
    return canvas.collection
