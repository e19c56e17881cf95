"""How far fits can be trusted: what their diagnosis says, before any of their numbers."""

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.convergence import DIGITS, LARGEST_RHAT, divergence
from pymc_hyperelastic.evidence.diagnosis import (
    diagnose_evidence,
    judgement,
    log_evidence,
)
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.evidence.verdicts import VERDICTS
from pymc_hyperelastic.models.settings import inflation_data_of
from pymc_hyperelastic.predictions.members import specimens_differ
from pymc_hyperelastic.reports.blocks import BAD, CAUTION, NOTE, Block, Found, Page, Table, short
from pymc_hyperelastic.reports.fits import by_name, has_data, posterior_rows
from pymc_hyperelastic.reports.measurements import warn_of_simulated

_LEVELS = dict(zip(VERDICTS, (NOTE, CAUTION, BAD), strict=True))


def check_fits(found: Found, page: Page) -> None:
    """Say what is against the evidences, the chains and the specimens of fitted classes."""
    for name, tree in by_name(found).items():
        of = f"{found.title}, class {name}" if name != found.title else name
        if has_data(tree):
            warn_of_simulated(tree["constant_data"].attrs, page)
        _check_evidence(of, tree, page)
        _check_chains(of, tree, page)
        if "specimens" in tree.children:
            _check_specimens(of, tree["specimens"].to_dataset(), page)
    _check_pooling(found, page)


def _check_evidence(of: str, tree: xr.DataTree, page: Page) -> None:
    try:
        diagnosis = diagnose_evidence(tree)
    except ValueError:
        page.notice(NOTE, f"{of}: the result holds no evidence, so that none was judged.")
        return
    page.check("the evidence of each class, by ph.diagnose_evidence")
    verdict = diagnosis.attrs["verdict"]
    if said := judgement(diagnosis):
        page.notice(_LEVELS[verdict], f"{of}: {said}.")
    if "residuals" in diagnosis["check"].values:
        page.check("whether the best curve of each test follows its data to within the noise")
    elif has_data(tree):
        page.complete = False
        page.notice(
            NOTE,
            f"{of}: the result does not say whether curves follow the data to within the noise: "
            "the noise was inferred for each specimen, or another version computed the result.",
        )
    if not np.isfinite(log_evidence(tree).standard_error) and verdict != VERDICTS[-1]:
        page.notice(BAD, f"{of}: the error of the evidence is infinite.")


def _check_chains(of: str, tree: xr.DataTree, page: Page) -> None:
    for words in divergence(tree):
        page.notice(CAUTION, f"{of}: {words}.")
    if tree["posterior"].sizes["chain"] == 1:
        page.notice(NOTE, f"{of}: there is one chain, which no other one confirms.")
    rows = posterior_rows(tree)
    if not np.isfinite([row.draws for row in rows]).all():
        page.notice(BAD, f"{of}: some draws of the posterior are no numbers.")
    rhat = {row.name: row.rhat for row in rows if np.isfinite(row.rhat)}
    if rhat:
        page.check(f"R-hat of each parameter, up to {LARGEST_RHAT}")
        worst = max(rhat, key=lambda name: round(rhat[name], DIGITS))
        if rhat[worst] > LARGEST_RHAT:
            page.notice(
                CAUTION,
                f"{of}: chains met different parts of the posterior: R-hat of {worst} is "
                f"{short(rhat[worst])}.",
            )


def _check_specimens(of: str, specimens: xr.Dataset, page: Page) -> None:
    page.check(f"Pareto shapes of the weights of each specimen, below {LARGEST_PARETO_K}")
    shape, error = specimens["pareto_k"].values, specimens["standard_error"].values
    for i, name in enumerate(specimens["specimen"].values.tolist()):
        if not np.isfinite(error[i]):
            page.notice(
                BAD, f"{of}: specimen {name} was given up: its integral has an infinite error."
            )
        elif shape[i] >= LARGEST_PARETO_K:
            page.notice(
                CAUTION,
                f"{of}: a few weights decide what is said of specimen {name}: their Pareto shape "
                f"is {short(float(shape[i]))}.",
            )


def _check_pooling(found: Found, page: Page) -> None:
    trees = [tree for tree in by_name(found).values() if has_data(tree)]
    shared = [tree for tree in trees if not specimens_differ(tree)]
    if any(len(set(inflation_data_of(t)["specimen"].values.tolist())) > 1 for t in shared):
        page.notice(
            NOTE,
            f"{found.title}: specimens that were fitted together share one set of parameters. Its "
            "posterior shrinks as data grow, however different they are, and probabilities of "
            "classes are then surer than these differences allow.",
        )


def show_trust(found: Found, page: Page) -> list[Block]:
    """The evidence of each class, and all that its diagnosis compared."""
    evidences, checks = [], []
    for name, tree in by_name(found).items():
        try:
            said = diagnose_evidence(tree)
        except ValueError:
            continue
        value, error = log_evidence(tree)
        evidences.append([name, value, error, said.attrs["verdict"]])
        for i, check in enumerate(said["check"].values.tolist()):
            own = said.isel(check=i)
            numbers = [float(own["value"]), float(own["limit"])]
            checks.append([check, name, *numbers, str(own["verdict"].item())])
    if not evidences:
        return []
    columns = ["class", "log evidence (nats)", "standard error", "verdict"]
    blocks: list[Block] = [Table(f"Evidence: {found.title}", columns, evidences)]
    if checks:
        columns = ["compared", "class", "value", "limit", "verdict"]
        caption = (
            f"What the verdicts rest on: {found.title}. A value is good up to its limit; of "
            "ancestors and residuals, from there on."
        )
        blocks.append(Table(caption, columns, checks))
    return blocks
