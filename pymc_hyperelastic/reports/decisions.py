"""What was classified: decisions, and how far they can be trusted."""

from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.evidence.stored import read_json
from pymc_hyperelastic.evidence.verdicts import VERDICTS
from pymc_hyperelastic.plots.laws import plot_law_probability
from pymc_hyperelastic.plots.probability import plot_class_probability
from pymc_hyperelastic.reports.blocks import (
    BAD,
    CAUTION,
    Block,
    Found,
    Page,
    Probability,
    Table,
    Text,
    in_words,
    is_table,
    plural,
    short,
    some_in_words,
)
from pymc_hyperelastic.reports.measurements import warn_of_simulated

# A specimen looks like one of a class in one of twenty cases by a smaller p-value.
_STRANGE = 0.05
# The most that one figure shows; more are parted.
_MOST_PANELS = 24
# Of more specimens those are shown by themselves whose class is not clear, and so many at most.
_MOST_ALONE = 200
# Messages of failures that stand before the numbers.
_MOST_MESSAGES = 10
# A decision with less than this probability is not clear.
_CLEAR = 0.95
# Digits to which probabilities are rounded before they are compared, so that rounding errors do not
# decide.
_DIGITS = 9


def is_classified(result: Any) -> bool:
    """Whether this comes from ``ph.classify``."""
    return is_table(result, "class_probability", "class_probability_se", "class_label")


def unit_of(result: xr.Dataset) -> str:
    """What was classified: the tests, or the specimens."""
    judged = result["class_probability" if "class_probability" in result else "error"]
    return next(str(d) for d in judged.dims if d != "class_label")


def names_of(result: xr.Dataset) -> list[str]:
    """Names of what was classified."""
    unit = unit_of(result)
    names = []
    for i in range(result.sizes[unit]):
        name = str(result["specimen"].values[i]) if "specimen" in result.coords else f"{i + 1}"
        if "experiment" in result.coords:
            name += f", experiment {result['experiment'].values[i]}"
        names.append(name)
    return names


def check_classified(found: Found, page: Page) -> None:
    """Say what cannot be judged, is in doubt, or looks like no class."""
    result: xr.Dataset = found.result
    warn_of_simulated(result.attrs, page)
    names = np.array(names_of(result), dtype=object)

    def tell(level: str, where: Any, words: str) -> None:
        if np.any(where):
            told = some_in_words(names[where].tolist())
            page.notice(level, f"{found.title}: {words}: {told}.")

    unit = unit_of(result)
    table = {
        str(k): v.transpose(unit, "class_label", ...).values
        for k, v in result.data_vars.items()
        if {unit, "class_label"} == set(v.dims)
    }
    page.check("decisions, and errors of the evidences and probabilities behind them")
    unknown = np.isnan(table["class_probability"]).any(axis=1)
    if "decision" in result:
        decision = result["decision"].values
        tell(BAD, decision == "cannot be judged", "cannot be judged")
        tell(CAUTION, decision == "none of these", "looks like none of the classes")
        tell(CAUTION, decision == "undecided", "undecided")
        unknown &= decision != "cannot be judged"
    for words in failures(result):
        page.notice(CAUTION, f"{found.title}: {words}.")
    tell(CAUTION, unknown & ~failed_of(result), "not classified, as after an interrupt")
    errors = [table[k] for k in ("class_probability_se", "log_evidence_se") if k in table]
    infinite = np.any([np.isinf(e).any(axis=1) for e in errors], axis=0)
    tell(BAD, infinite, "a probability or an evidence has an infinite error")
    if "pareto_k" in table:
        page.check(f"Pareto shapes of the weights, below {LARGEST_PARETO_K}")
        heavy = (table["pareto_k"] >= LARGEST_PARETO_K).any(axis=1)
        words = f"a few weights decide an evidence (Pareto shape from {LARGEST_PARETO_K} on)"
        tell(CAUTION, heavy, words)
    if "p_value" in table:
        page.check(f"p-values of each class, from {_STRANGE}")
        strange = (table["p_value"] < _STRANGE).all(axis=1)
        tell(CAUTION, strange, f"strange to every class (all p-values below {_STRANGE})")
    else:
        page.notice(
            CAUTION,
            f"{found.title}: the classes have no variability, all specimens of one share one set "
            "of parameters. Where specimens differ, such probabilities are far too sure.",
        )
    if "class_verdict" in result:
        for label, verdict in zip(
            result["class_label"].values.tolist(), result["class_verdict"].values, strict=True
        ):
            if verdict != VERDICTS[0]:
                level = BAD if verdict == VERDICTS[-1] else CAUTION
                page.notice(level, f"{found.title}: the fit of class {label} is {verdict}.")


def failed_of(result: xr.Dataset) -> Any:
    """Whether each specimen or experiment failed."""
    if "error" not in result:
        return np.zeros(result.sizes[unit_of(result)], bool)
    return result["error"].values.astype(str) != ""


def failures(result: xr.Dataset) -> list[str]:
    """What is said of those that failed, message by message."""
    if not failed_of(result).any():
        return []
    errors = result["error"].values.astype(str)
    names = np.array(names_of(result), dtype=object)
    messages = sorted(set(errors.tolist()) - {""})
    words = [
        f"{some_in_words(names[errors == message].tolist())}: {message.rstrip('.')}"
        for message in messages[:_MOST_MESSAGES]
    ]
    rest = np.isin(errors, messages[_MOST_MESSAGES:])
    if rest.any():
        words.append(f"{some_in_words(names[rest].tolist())} failed for other reasons")
    return words


def show_classified(found: Found, page: Page) -> list[Block]:
    """Probabilities of the classes with their errors, as a figure and a table."""
    blocks: list[Block] = []
    if found.result.sizes[unit_of(found.result)] > _MOST_ALONE:
        blocks = _counted(found)
        found = Found(found.title, _least_clear(found.result))
    result: xr.Dataset = found.result
    unit = unit_of(result)
    count = result.sizes[unit]
    for start in range(0, count, _MOST_PANELS):
        part = result.isel({unit: slice(start, start + _MOST_PANELS)})
        last = min(start + _MOST_PANELS, count)
        some = f", {start + 1} to {last} of {count}" if count > _MOST_PANELS else ""
        blocks += page.figure(
            plot_class_probability,
            part,
            label=f"Probability of each class: {found.title}{some}",
            caption=f"Probability of each class{some}: {found.title}. Lines at the bars: one "
            "standard error to each side.",
        )
    if count:
        blocks.append(_decisions(found))
        if result.sizes.get("part", 0) > 1:  # of one part it would be the ratio itself
            blocks.append(_parts(found))
    if "strain_energy_probability" in result:
        blocks += page.figure(
            plot_law_probability,
            result,
            label=f"Probability of each strain energy: {found.title}",
            caption=f"Probability of each strain energy: {found.title}.",
        )
        laws = result["strain_energy"].values.tolist()
        names = ["probability", "log_evidence"]
        columns = [
            result[f"strain_energy_{name}{end}"].values for name in names for end in ("", "_se")
        ]
        rows = [
            [str(law), Probability(columns[0][i]), *(float(c[i]) for c in columns[1:])]
            for i, law in enumerate(laws)
        ]
        headings = ["probability", "its standard error", "log evidence", "its standard error"]
        caption = f"Strain energies over which was averaged: {found.title}"
        blocks.append(Table(caption, ["strain energy", *headings], rows))
    return blocks


def _probable(result: xr.Dataset) -> Any:
    """Probability of the most probable class; 0 of what was not, or could not be, classified."""
    probability = result["class_probability"].max("class_label").fillna(0.0).values.round(_DIGITS)
    if "decision" in result:
        labels = result["class_label"].values.astype(str)
        probability = np.where(np.isin(result["decision"].values, labels), probability, 0.0)
    return probability


def _least_clear(result: xr.Dataset) -> xr.Dataset:
    """Those whose class is least clear, in their order."""
    probable = _probable(result)
    chosen = np.argsort(probable, kind="stable")[:_MOST_ALONE]
    return result.isel({unit_of(result): np.sort(chosen[probable[chosen] < _CLEAR])})


def _counted(found: Found) -> list[Block]:
    """How many have which decision; who is shown alone."""
    result: xr.Dataset = found.result
    probable = _probable(result)
    unit = "experiments" if unit_of(result) == "test" else "specimens"
    clear = int((probable >= _CLEAR).sum())
    alone = min(len(probable) - clear, _MOST_ALONE)
    words = Text(
        f"Of {len(probable)} {unit} {clear} have a class with a probability from {_CLEAR} on. Of "
        f"the other {len(probable) - clear}, the {alone} whose class is least clear are shown; all "
        "are in the result."
    )
    if "decision" not in result:
        return [words]
    decision = result["decision"].values.astype(str)
    names, counts = np.unique(decision, return_counts=True)
    rows = [
        [name or "not classified", int(count), int((probable[decision == name] >= _CLEAR).sum())]
        for name, count in zip(names.tolist(), counts.tolist(), strict=True)
    ]
    columns = ["decision", unit, f"with a probability from {_CLEAR} on"]
    return [Table(f"Decisions: {found.title}", columns, rows), words]


def _decisions(found: Found) -> Table:
    result: xr.Dataset = found.result
    names = names_of(result)
    numbers = {
        "class_probability": "probability",
        "class_probability_se": "its standard error",
        "log_evidence": "log evidence",
        "log_evidence_se": "its standard error",
        "pareto_k": "Pareto shape",
        "p_value": "p-value",
    }
    there = {name: heading for name, heading in numbers.items() if name in result}
    told = [name for name in ("group",) if name in result.coords]
    rows = []
    for i, name in enumerate(names):
        own = result.isel({unit_of(result): i})
        decided = str(own["decision"].item()) or "not classified" if "decision" in own else ""
        for label in result["class_label"].values.tolist():
            of_class = own.sel(class_label=label)
            row: list[Any] = [name, *(str(own[t].item()) for t in told), decided, str(label)]
            row += [_number(n, of_class[n]) for n in there]
            rows.append(row + [str(of_class["method"].item())] * ("method" in result))
    columns = [
        "experiment" if "experiment" in result.coords else "specimen",
        *(f"known {t}" for t in told),
        "decision",
        "class",
        *there.values(),
        *["integrated by"] * ("method" in result),
    ]
    return Table(f"Decisions and probabilities: {found.title}", columns, rows)


def _number(name: str, value: Any) -> float:
    return Probability(value) if name in ("class_probability", "p_value") else float(value)


def _parts(found: Found) -> Table:
    result: xr.Dataset = found.result
    parts = [str(p) for p in result["part"].values]
    rows = []
    for i, name in enumerate(names_of(result)):
        for label in result["class_label"].values.tolist():
            own = result.isel({unit_of(result): i}).sel(class_label=label)
            rival = [str(own["rival"].item())] if "rival" in own else []
            values = [float(own["log_ratio_part"].sel(part=p)) for p in parts]
            rows.append([name, str(label), *rival, *values])
    against = ["against"] if "rival" in result else []
    caption = (
        f"What speaks for each class, in nats: {found.title}. The parts add up to the log ratio "
        "of the evidences of the class and of its rival."
    )
    return Table(caption, ["of", "class", *against, *parts], rows)


def classified_sentences(found: Found) -> list[str]:
    """How it was classified, as sentences of an article."""
    result: xr.Dataset = found.result
    unit = unit_of(result)
    count = result.sizes[unit]
    what = plural(count, "experiment" if unit == "test" else "specimen")
    labels = [str(label) for label in result["class_label"].values]
    classes = "class" if len(labels) == 1 else "classes"
    sentences = [
        f"The curves of {what} were held against the {classes} {in_words(labels)} by marginal "
        "likelihood: the likelihood of the new curves, averaged over the posterior of a class."
    ]
    prior = read_json(result, "class_prior", {})
    if prior and len({round(p, 12) for p in prior.values()}) == 1:
        sentences += ["All classes were equally probable beforehand."] if len(prior) > 1 else []
    elif prior:
        told = in_words([f"{short(p)} of {name}" for name, p in prior.items()])
        sentences.append(f"The probabilities beforehand were {told}.")
    if below := float(result.attrs.get("undecided_below", 0.0)):
        sentences.append(
            f"It was left undecided where the most probable class had a probability below "
            f"{short(below)}."
        )
    if below := float(result.attrs.get("none_below", 0.0)):
        sentences.append(
            f"Where the p-value of every class was below {short(below)}, the decision was that it "
            "is none of these."
        )
    if "strain_energy_probability" in result:
        laws = [str(law) for law in result["strain_energy"].values]
        sentences.append(
            f"Probabilities were averaged over the strain energies {in_words(laws)}, each counting "
            "by its posterior probability."
        )
    return sentences
