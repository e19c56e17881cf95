"""The commands of the command line."""

import shutil
from collections.abc import Callable
from enum import Enum, StrEnum
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer
import xarray as xr

from pymc_hyperelastic.classes.classify import classify as classify_new
from pymc_hyperelastic.classes.compare_classes import compare_classes
from pymc_hyperelastic.classes.fit import fit_classes
from pymc_hyperelastic.classes.groups import kind_of_groups
from pymc_hyperelastic.classes.quantities import parameters_of
from pymc_hyperelastic.command.sizes import likelihood_of_options, size_of
from pymc_hyperelastic.command.study import CLASSES, CLASSIFIED, COMPARISON, classes_of, results_of
from pymc_hyperelastic.data.files import read_tests
from pymc_hyperelastic.data.files.read import settings_of_study
from pymc_hyperelastic.data.select import select
from pymc_hyperelastic.data.sheets import tubes_of
from pymc_hyperelastic.evidence.diagnosis import log_evidence
from pymc_hyperelastic.io.results import save_result
from pymc_hyperelastic.io.store import OtherWork, Store
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy, list_strain_energies
from pymc_hyperelastic.models.settings import inflation_data_of
from pymc_hyperelastic.models.variability import Variability
from pymc_hyperelastic.plots.inflation import plot_inflation
from pymc_hyperelastic.plots.sheet_tests import plot_sheet_tests
from pymc_hyperelastic.predictions.conditions import Conditions
from pymc_hyperelastic.reports.comparison import is_of_tubes
from pymc_hyperelastic.reports.page import frame_of, in_words
from pymc_hyperelastic.reports.report import report as write_report

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)

Files = Annotated[
    list[Path], typer.Argument(help="Tables (CSV, TSV, text), and perhaps a TOML file about them.")
]
Settings = Annotated[
    Path | None, typer.Option(help="A TOML file: columns, units, constants and conventions.")
]
Study = Annotated[Path, typer.Option("--out", help="Folder of the study.")]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace results of other data or settings.")
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress.")]
Seed = Annotated[int, typer.Option(help="The same seed gives the same numbers.")]
PressureSd = Annotated[
    str | None,
    typer.Option(
        help="Standard deviation of pressures, as in '2 mmHg', or 'unknown' (the default)."
    ),
]
ForceSd = Annotated[
    str | None,
    typer.Option(help="The same of axial forces, as in '0.5 mN'; without it they are left out."),
]
ForceOffsetSd = Annotated[
    str | None, typer.Option(help="Standard deviation of the zero of the force transducer.")
]
DiameterSd = Annotated[
    str | None, typer.Option(help="Standard deviation of diameters, as in '5 um'.")
]
StressSd = Annotated[
    str | None,
    typer.Option(help="Standard deviation of stresses of sheets, as in '5 kPa', or unknown."),
]
Sigma = Annotated[
    str | None,
    typer.Option(
        help="In place of --pressure-sd, with slopes: √2 standard deviations of pressures."
    ),
]
ForceSigma = Annotated[
    str | None,
    typer.Option(help="With --sigma in place of --force-sd: √2 standard deviations of forces."),
]
SlopeWeight = Annotated[
    float | None, typer.Option(help="With --sigma, weight of slopes, mm²; else balanced.")
]
Law = Enum("Law", {name: name for name in list_strain_energies()}, type=str)  # type: ignore[misc]


class Differences(StrEnum):
    """How the specimens of a group differ: not at all, or each has its own parameters."""

    none = "none"
    specimen = "specimen"


class By(StrEnum):
    """The unit of a decision."""

    specimen = "specimen"
    test = "test"


# Unit of pressures in figures and reports of the command line.
_IN_MMHG = Conditions(pressure_unit="mmHg")
_INSTEAD = "replace it with --overwrite, or name another folder with --out"


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"pymc-hyperelastic {version('pymc-hyperelastic')}")
        raise typer.Exit


@app.callback()
def command(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Tests of soft tubes and sheets: from tables to probabilities. Start with 'check FILE'."""


@app.command()
def check(
    files: Files,
    settings: Settings = None,
    figure: Annotated[Path, typer.Option(help="File of the figure.")] = Path("curves.png"),
) -> None:
    """Print how tables are understood and their errors, and draw the curves."""
    data = read_tests(files, settings)
    typer.echo(data.attrs["understood"])
    if figure.is_dir() or not figure.suffix:
        raise ValueError(f"--figure is {str(figure)!r}; expected a file such as curves.png")
    figure.parent.mkdir(parents=True, exist_ok=True)
    if tubes_of(data) is None:
        drawn = plot_sheet_tests(data)
    else:  # a figure has tests of one kind
        drawn = plot_inflation(data, pressure_unit=_IN_MMHG.pressure_unit)
    drawn.savefig(figure, dpi=150)
    typer.echo(f"\nThe curves are drawn in {figure}.")


@app.command()
def fit(
    files: Files,
    settings: Settings = None,
    law: Annotated[list[Law] | None, typer.Option(help="A strain energy; may be repeated.")] = None,
    variability: Annotated[
        Differences, typer.Option(help="How the specimens of a group differ.")
    ] = Differences.specimen,
    experiment_effect: Annotated[
        bool, typer.Option(help="Experiments on a specimen differ by more than noise.")
    ] = False,
    pressure_sd: PressureSd = None,
    force_sd: ForceSd = None,
    force_offset_sd: ForceOffsetSd = None,
    diameter_sd: DiameterSd = None,
    stress_sd: StressSd = None,
    sigma: Sigma = None,
    force_sigma: ForceSigma = None,
    slope_weight: SlopeWeight = None,
    draws: Annotated[int, typer.Option(help="Draws of a chain.")] = 1000,
    chains: Annotated[int, typer.Option(help="Independent runs.")] = 4,
    study: Study = Path("study"),
    seed: Seed = 1,
    quiet: Quiet = False,
    overwrite: Overwrite = False,
) -> None:
    """Learn a class of each group of specimens.

    If a table has a column 'split', its rows marked 'train' are used. After an interrupt the same
    command continues. The options of errors may stand in a table [likelihood] of the TOML file.
    """
    options = {
        "pressure_sd": pressure_sd,
        "force_sd": force_sd,
        "force_offset_sd": force_offset_sd,
        "diameter_sd": diameter_sd,
        "stress_sd": stress_sd,
        "sigma": sigma,
        "force_sigma": force_sigma,
        "slope_weight": slope_weight,
    }
    data = _split(read_tests(files, settings), "train")
    groups = list(dict.fromkeys(data["group"].values.tolist()))
    stated = settings_of_study(files, settings).likelihood
    alike = variability is Differences.none
    fit_law = partial(
        fit_classes,
        groups={str(group): select(data, group=group) for group in groups},
        likelihood=likelihood_of_options(options, stated, data),
        variability=None if alike else Variability(experiment_effect=experiment_effect),
        draws=draws,
        chains=chains,
        random_seed=seed,
        progressbar=not quiet,
    )
    if alike and experiment_effect:
        raise ValueError("--experiment-effect needs --variability specimen")
    study.mkdir(parents=True, exist_ok=True)
    for each in law or [Law("Ogden")]:
        _fit_law(each.value, fit_law, study, overwrite=overwrite)


def _fit_law(law: str, fit_law: Callable[..., Any], study: Path, *, overwrite: bool) -> None:
    """Fit the classes with one strain energy, save them in a folder, and print the evidences."""
    path = study / f"{CLASSES}-{law}.nc"
    store = path.with_suffix("")
    if path.exists() and not store.exists() and not overwrite:
        raise ValueError(f"{path} exists already: {_INSTEAD}")
    compute = partial(fit_law, StrainEnergy.from_name(law), store=store)
    classes = _computed(compute, store, overwrite=overwrite)
    save_result(classes, path)
    for name, fitted in classes.children.items():
        typer.echo(f"{law}, group {name}: log evidence {log_evidence(fitted)}")
    typer.echo(f"The classes are in {path}.")


@app.command()
def classify(
    files: Files,
    settings: Settings = None,
    study: Study = Path("study"),
    by: Annotated[
        By, typer.Option(help="Classify all tests of a specimen together, or each experiment.")
    ] = By.specimen,
    undecided_below: Annotated[float, typer.Option(help="Least probability of a decision.")] = 0.0,
    none_below: Annotated[
        float, typer.Option(help="P-value below which a specimen is of no class.")
    ] = 0.0,
    cores: Annotated[int | None, typer.Option(help="Processes; all cores by default.")] = None,
    seed: Seed = 1,
    quiet: Quiet = False,
    overwrite: Overwrite = False,
) -> None:
    """Say of which class new specimens are.

    If a table has a column 'split', its rows marked 'new' are used. After an interrupt the same
    command continues.
    """
    data = _split(read_tests(files, settings), "new")
    classes, *others = classes_of(study)
    compute = partial(
        classify_new,
        data,
        classes,
        by=by.value,
        average_over=others,
        undecided_below=undecided_below,
        none_below=none_below,
        store=Store(study / CLASSIFIED, cores=cores),
        random_seed=seed,
        progressbar=not quiet,
    )
    table = _table(_computed(compute, study / CLASSIFIED, overwrite=overwrite).load())
    path = study / "classified.csv"
    _without_formulas(table).to_csv(path, index=False)
    typer.echo(table.to_string(index=False, float_format="{:.3f}".format))
    typer.echo(f"\nThis table is in {path}.")


@app.command()
def compare(
    study: Study = Path("study"),
    quantity: Annotated[
        list[str] | None, typer.Option(help="A property or a parameter; may be repeated.")
    ] = None,
    pressure: Annotated[str, typer.Option(help="At which pressure.")] = "100 mmHg",
    pressure_range: Annotated[
        str | None, typer.Option(help="Diastolic and systolic pressure, as in '80-120 mmHg'.")
    ] = None,
    pair: Annotated[
        str | None, typer.Option(help="Column that names the animal, before and after.")
    ] = None,
    covariate: Annotated[
        list[str] | None, typer.Option(help="Column of an age, sex or batch; may be repeated.")
    ] = None,
    seed: Seed = 1,
) -> None:
    """Say in what groups differ, by how much, and how sure that is."""
    between = None
    if pressure_range is not None:
        low, dash, rest = pressure_range.partition("-")
        high = size_of("--pressure-range", rest if dash else "", "pressure")
        between = [size_of("--pressure-range", low + _unit_of(rest), "pressure"), high]
    trees = classes_of(study)
    result = compare_classes(
        trees if len(trees) > 1 else trees[0],
        quantity or _quantities_of(trees),
        at=Conditions(size_of("--pressure", pressure, "pressure"), pressure_range=between),
        pair=pair,
        covariates=covariate,
        random_seed=seed,
    )
    path = study / f"{COMPARISON}-{'paired' if pair else 'groups'}.nc"
    save_result(result, path)
    dims = ["quantity", "statistic", "comparison"]
    names = " ".join([*dims, "difference_interval", "unit", "probability_of_rise"])
    table = frame_of(result, names, *dims)
    words = table.apply(lambda column: column.map(partial(in_words, heading=column.name)))
    typer.echo(words.to_string(index=False))
    typer.echo(
        "\nA typical specimen is the middle one of its group; mean and spread are the mean and the "
        "standard deviation over all specimens of the group, measured or not."
    )
    if is_of_tubes(result):
        at = f"{pressure}, with the pressure range {pressure_range}" if between else pressure
        typer.echo(f"Properties of the tube are those at {at}.")
    typer.echo(f"All results of the comparison are in {path}.")


@app.command()
def report(
    study: Study = Path("study"),
    page: Annotated[Path | None, typer.Option(help="The HTML file.")] = None,
    title: Annotated[str | None, typer.Option(help="Heading of the page.")] = None,
) -> None:
    """Write one HTML page of all that a study holds."""
    page = page or study / "report.html"
    if page.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"--page is {str(page)!r}; expected a file that ends with .html")
    path = write_report(results_of(study), page, title=title, at=_IN_MMHG)
    typer.echo(f"The report is {path}.")


def _quantities_of(trees: list[xr.DataTree]) -> list[str]:
    """Return properties of tubes or, for sheets alone, the parameters that all laws have."""
    fitted = [each for tree in trees for each in tree.children.values()]
    if any(tubes_of(inflation_data_of(each)) is not None for each in fitted):
        return ["log compliance", "circumferential_material_stiffness"]
    parameters = [parameters_of(kind_of_groups(tree)) for tree in trees]
    shared = [name for name in parameters[0] if all(name in of for of in parameters)]
    if not shared:
        raise ValueError(
            "the study holds tests of sheets alone, and its laws share no parameter: keep one of "
            f"the files {CLASSES}-*.nc in the folder, whose parameters are then compared"
        )
    return shared


def _computed(compute: Callable[[], Any], store: Path, *, overwrite: bool) -> Any:
    """Return a result that a store keeps; remove a store of other data or settings if asked to."""
    try:
        return compute()
    except OtherWork as error:
        if not overwrite:
            raise ValueError(f"{error.said}You can {_INSTEAD}") from error
    shutil.rmtree(store)
    return compute()


def _split(data: xr.Dataset, which: str) -> xr.Dataset:
    """Return the tests of one split, if the tables have a column split."""
    return select(data, split=which) if "split" in data.coords else data


def _unit_of(text: str) -> str:
    return text.lstrip(" -+.0123456789")


def _without_formulas(table: pd.DataFrame) -> pd.DataFrame:
    """Text that a spreadsheet would compute is marked as text by an apostrophe."""
    text = table.select_dtypes(exclude="number").astype(str)
    marked = text.mask(text.apply(lambda column: column.str.match(r"[=+\-@\t]")), "'" + text)
    return table.assign(**{name: marked[name] for name in marked})


def _table(result: xr.Dataset) -> pd.DataFrame:
    """Decisions and probabilities, a row for each that was judged."""
    labels = [n for n in ("specimen", "experiment", "group") if n in result.coords]
    table = pd.DataFrame({name: result[name].values for name in [*labels, "decision"]})
    for name in result["class_label"].values:
        own = result.sel(class_label=name)
        table[f"P({name})"] = own["class_probability"].values
        table[f"± {name}"] = own["class_probability_se"].values
        if "p_value" in own:
            table[f"p-value {name}"] = own["p_value"].values
    table["error"] = result["error"].values
    return table
