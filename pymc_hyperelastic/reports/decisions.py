"""Classified specimens or experiments in a report."""

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.evidence.stored import read_json
from pymc_hyperelastic.evidence.verdicts import VERDICTS
from pymc_hyperelastic.plots.laws import plot_law_probability
from pymc_hyperelastic.plots.probability import plot_class_probability
from pymc_hyperelastic.reports.meanings import NATS, PARETO_K
from pymc_hyperelastic.reports.measurements import warn_of_simulated
from pymc_hyperelastic.reports.page import (
    BAD,
    CAUTION,
    MOST_LISTED,
    PROB,
    Page,
    frame_of,
    in_words,
    listed,
    plural,
)
from pymc_hyperelastic.rounding import DIGITS, short

# P-value below which a specimen is atypical of a class.
_ATYPICAL = 0.05
# Specimens that are shown one by one at most; of more, those with the least clear class.
_MOST_SHOWN = 200
_LAW_COLUMNS = "strain_energy strain_energy_probability strain_energy_log_evidence"
# Decisions that name no class, in words of the table and the summary.
_NO_CLASS = {
    "": "not classified",
    "none of these": "none of these classes",
    "undecided": "undecided",
    "cannot be judged": "cannot be judged",
}
_P_VALUE = (
    "A p-value is the probability that a specimen of the class is at least as unusual as this "
    f"one; below {_ATYPICAL} the specimen is atypical of the class."
)
_UNITS = {"specimen": "new specimen", "test": "new experiment"}
_MEASURE_MORE = "Measure more curves of these specimens, or more specimens of each group"


def unit_of(result: xr.Dataset) -> str:
    """Return the dimension of a result with one entry per specimen or experiment."""
    return "test" if "test" in result.sizes else "specimen"


def names_of(result: xr.Dataset) -> np.ndarray:
    """Return the name of each specimen or experiment."""
    unit = unit_of(result)
    numbers = np.arange(1, result.sizes[unit] + 1)
    names = (result["specimen"].values if "specimen" in result.coords else numbers).astype(str)
    if "experiment" in result.coords:
        tests = result["experiment"].values.astype(str)
        names = [f"{name}, experiment {test}" for name, test in zip(names, tests, strict=True)]
    return np.array(names, dtype=object)


def failed_of(result: xr.Dataset) -> np.ndarray:
    """Return which specimens or experiments failed."""
    if "error" not in result:
        return np.zeros(result.sizes[unit_of(result)], bool)
    return result["error"].values.astype(str) != ""


def warn_of_messages(result: xr.Dataset, page: Page) -> None:
    """Add a notice for each message of an error or doubt, with the names of the specimens."""
    names = names_of(result)
    for variable in ("error", "doubtful"):
        if variable not in result:
            continue
        messages = result[variable].values.astype(str)
        different = sorted({*messages.tolist()} - {""})
        for message in different[:MOST_LISTED]:
            words = f"{listed(names[messages == message])}: {message}"
            page.notice(CAUTION, words, "Look at the data of these specimens")
        rest = np.isin(messages, different[MOST_LISTED:])
        if rest.any():
            words = f"{listed(names[rest])}: other messages in the variable {variable}"
            page.notice(CAUTION, words, "Read that variable of the result")


def _check_decisions(result: xr.Dataset, page: Page) -> None:
    """Add notices on specimens without a reliable decision, and on doubtful classes."""
    unit = unit_of(result)
    table = {
        str(name): variable.transpose(unit, "class_label").values
        for name, variable in result.data_vars.items()
        if {*variable.dims} == {unit, "class_label"}
    }
    decision = result["decision"].values
    judged = decision != "cannot be judged"
    unknown = np.isnan(table["class_probability"]).any(axis=1) & judged & ~failed_of(result)
    errors = [table[k] for k in ("class_probability_se", "log_evidence_se") if k in table]
    infinite = np.any([np.isinf(error).any(axis=1) for error in errors], axis=0)
    more_draws = "Fit the classes again with more draws"
    data = "Look at the curves of these specimens for errors, and at the units"
    cases = [
        (BAD, "cannot be judged", f"{data}. {more_draws}", ~judged),
        (CAUTION, "looks like none of the classes", data, decision == "none of these"),
        (CAUTION, "undecided", _MEASURE_MORE, decision == "undecided"),
        (
            CAUTION,
            "not classified, for example after an interrupt",
            "Call ph.classify again with the same store",
            unknown,
        ),
        (BAD, "the error of a probability or evidence is infinite", more_draws, infinite),
    ]
    if "pareto_k" in table:
        heavy = (table["pareto_k"] >= LARGEST_PARETO_K).any(axis=1)
        words = f"a few weights dominate an evidence (Pareto shape of {LARGEST_PARETO_K} or more)"
        cases.append((CAUTION, words, more_draws, heavy))
    if "p_value" in table:
        atypical = (table["p_value"] < _ATYPICAL).all(axis=1)
        words = f"atypical of all classes (p-values below {_ATYPICAL})"
        cases.append((CAUTION, words, f"{data}. Do not trust their class probabilities", atypical))
    else:
        page.notice(
            CAUTION,
            "the classes have no variability: all specimens of a class share one set of "
            "parameters. If specimens differ, class probabilities are overconfident",
            'Fit the classes with variability="specimen"',
        )
    names = names_of(result)
    for level, words, todo, where in cases:
        page.notice_where(level, words, todo, names, where)
    if "class_verdict" in result:
        for label, verdict in result["class_verdict"].to_series().items():
            if verdict != VERDICTS[0]:
                level = BAD if verdict == VERDICTS[-1] else CAUTION
                page.notice(level, f"the fit of class {label} is {verdict}", more_draws)


def show_classified(result: xr.Dataset, page: Page) -> None:
    """Add probabilities of the classes, and of the strain energies if they were averaged."""
    warn_of_simulated(result.attrs, page)
    warn_of_messages(result, page)
    _check_decisions(result, page)
    _add_methods(result, page)
    unit = unit_of(result)
    page.findings.append(_finding(result))
    if result.sizes[unit] > _MOST_SHOWN:
        result = _least_clear(result, page)
    count = result.sizes[unit]
    for start in range(0, count, MOST_LISTED):
        end = min(start + MOST_LISTED, count)
        some = f", {start + 1} to {end} of {count}" if count > MOST_LISTED else ""
        page.figure(
            f"Class probabilities{some}",
            plot_class_probability,
            result.isel({unit: slice(start, end)}),
            note="Lines at the bars: ± one standard error.",
        )
    if count:
        _show_decisions(result, page)
    if "strain_energy_probability" in result:
        page.figure("Probability of each strain energy", plot_law_probability, result)
        frame = frame_of(result, _LAW_COLUMNS, "strain_energy")
        page.table("Strain energies in the average", frame)


def _finding(result: xr.Dataset) -> str:
    """Return a sentence on the decisions, and the probabilities of the most probable classes."""
    unit = unit_of(result)
    decision = pd.Series(result["decision"].values.astype(str)).replace(_NO_CLASS)
    counts = listed([f"{n} {words}" for words, n in decision.value_counts(sort=False).items()])
    found = f"Decisions on {plural(len(decision), _UNITS[unit])}: {counts}"
    best = result["class_probability"].fillna(0.0).argmax("class_label")
    highest = frame_of(result.isel(class_label=best), "class_label class_probability", unit)
    known = [estimate for estimate in highest["class probability"] if estimate.value >= 0]
    if not known:
        return f"{found}."
    if len(decision) == 1:
        name, chance = highest["class label"][0], in_words(known[0], "probability")
        found = f"Decision on {names_of(result)[0]}: {decision[0]}"
        return f"{found}; the most probable class, {name}, has the probability {chance}."
    low, high = (in_words(f(known).value, "probability") for f in (min, max))
    return f"{found}; the most probable classes have probabilities from {low} to {high}."


def _show_decisions(result: xr.Dataset, page: Page) -> None:
    """Add a table with a row for each specimen, and its probability and p-value of each class."""
    unit = unit_of(result)
    frame = pd.DataFrame({"specimen": names_of(result)}, dtype=object)
    if "group" in result.coords:
        frame["group"] = result["group"].values.astype(str)
    frame["decision"] = [
        _NO_CLASS.get(d, d) for d in result["decision"].values.astype(str).tolist()
    ]
    note = "The error is the standard error of the computation, from the number of draws."
    for name, heading in (("class_probability", "probability of"), ("p_value", "p-value in")):
        for label in result["class_label"].values.tolist() if name in result else ():
            own = frame_of(result.sel(class_label=label, drop=True), name, unit)
            frame[f"{heading} {label}"] = own.iloc[:, 0]
    if "p_value" in result:
        note += f" {_P_VALUE}"
    page.table("Decisions and probabilities", frame, note, keep="decision")


def show_diagnosis(result: xr.Dataset, page: Page) -> None:
    """Add how the evidence of each specimen under each class was computed."""
    unit = unit_of(result)
    if result.sizes[unit] > _MOST_SHOWN:
        return
    labels = [name for name in ("specimen", unit) if name in result.coords]
    table = result.drop_vars(labels).assign(name=(unit, names_of(result)))
    table = table.rename(class_label="class")
    names = "name class log_evidence pareto_k method"
    frame = frame_of(table, names, unit, "class")
    page.table("Evidence of each specimen", frame, f"{NATS} {PARETO_K}")


def show_explanation(result: xr.Dataset, page: Page) -> None:
    """Add the parts of the log ratios of evidences."""
    parts = result["part"].values.tolist()
    rows = []
    for i, name in enumerate(names_of(result)):
        for label in result["class_label"].values.tolist():
            own = result.isel({unit_of(result): i}).sel(class_label=label)
            numbers = own["log_ratio_part"].sel(part=parts).values.tolist()
            rows.append([name, label, str(own["rival"].item()), *numbers])
    page.table(
        "Support for each class, in nats",
        pd.DataFrame(rows, columns=["specimen", "class", "compared with", *parts]),
        "The parts add up to the log ratio of the evidences of the two classes.",
    )


def _least_clear(result: xr.Dataset, page: Page) -> xr.Dataset:
    """Count the decisions, and return the specimens or experiments with the least clear class."""
    unit = unit_of(result)
    probability = result["class_probability"].max("class_label").fillna(0.0).values.round(DIGITS)
    decision = result["decision"].values.astype(str)
    labels = result["class_label"].values.astype(str)
    probability = np.where(np.isin(decision, labels), probability, 0.0)
    clear = probability >= PROB
    units = "experiments" if unit == "test" else "specimens"
    frame = pd.DataFrame({"decision": decision, units: 1, "with a clear class": clear.astype(int)})
    frame["decision"] = frame["decision"].replace("", "not classified")
    page.table("Decisions", frame.groupby("decision").sum().reset_index())
    unclear = np.flatnonzero(~clear)
    chosen = unclear[np.argsort(probability[unclear], kind="stable")[:_MOST_SHOWN]]
    page.text(
        f"A class is clear if its probability is at least {PROB}: that of {clear.sum()} of "
        f"{len(clear)} {units}. Shown below: {len(chosen)} of {len(unclear)} without a clear "
        "class, those with the lowest probabilities. The result holds all of them."
    )
    return result.isel({unit: np.sort(chosen)})


def _add_methods(result: xr.Dataset, page: Page) -> None:
    """Add sentences on how decisions were made."""
    unit = unit_of(result)
    what = plural(result.sizes[unit], "experiment" if unit == "test" else "specimen")
    labels = result["class_label"].values.tolist()
    page.methods.append(
        f"The curves of {what} were compared with the {'class' if len(labels) == 1 else 'classes'} "
        f"{listed(labels)} by marginal likelihood, the likelihood of the new curves averaged over "
        "the posterior of a class."
    )
    prior = read_json(result, "class_prior", {})
    if len({round(p, DIGITS) for p in prior.values()}) > 1:
        probabilities = listed([f"{short(p)} for {name}" for name, p in prior.items()])
        page.methods.append(f"The prior probabilities of the classes were {probabilities}.")
    elif len(prior) > 1:
        page.methods.append("All classes had the same prior probability.")
    if limit := float(result.attrs.get("undecided_below", 0.0)):
        page.methods.append(
            "No decision was made if the probability of the most probable class was below "
            f"{short(limit)}."
        )
    if limit := float(result.attrs.get("none_below", 0.0)):
        page.methods.append(
            f"If the p-value of every class was below {short(limit)}, the decision was none of "
            "these classes."
        )
    if "strain_energy_probability" in result:
        laws = listed(result["strain_energy"].values.tolist())
        page.methods.append(
            f"Class probabilities were averaged over the strain energies {laws}, weighted by "
            "their posterior probabilities."
        )
