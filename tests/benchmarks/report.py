"""Write the results of the benchmarks as the tables of their documentation page.

``python report.py results/benchmark.json`` reads what pytest-benchmark stored; a benchmark that was
not run leaves a dash.
"""

import argparse
import json
import math
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs" / "project"
DASH = "–"


def tables(results):
    """Return the Markdown of all tables, under a line that names the machine."""
    groups = {}
    for benchmark in results["benchmarks"]:
        # The name of a case is the name of a peer, or such as "points=600".
        value = benchmark["param"].split("=")[-1]
        groups.setdefault(benchmark["group"], {})[value] = benchmark
    return "\n\n".join(
        [
            machine(results["machine_info"]),
            "### Evidence of one class\n\n" + evidence(groups),
            "### Number of points\n\n" + by_points(groups),
            "### Number of particles\n\n" + by_particles(groups),
            "### Number of new experiments\n\n" + by_experiments(groups),
        ]
    )


def machine(info):
    cpu = info["cpu"].get("brand_raw", info["machine"])
    packages = ", ".join(f"{name} {version}" for name, version in info["versions"].items())
    return (
        f"One of {info['cores']} cores of {cpu}, {info['system']}; "
        f"Python {info['python_version']}, {packages}."
    )


def evidence(groups):
    """Peers, their times as multiples of the first one's, and their accuracy."""
    cold, warm = groups.get("cold", {}), groups.get("warm", {})
    rows = []
    for name in dict.fromkeys([*warm, *cold]):
        runs = [group.get(name) for group in (cold, warm)]
        ours = [group.get("package") for group in (cold, warm)]
        done = [run for run in runs if run]
        errors = [error for run in done for error in run["extra_info"]["error"]]
        rows.append(
            [
                done[0]["extra_info"]["title"],
                *(cell for pair in zip(runs, ours, strict=True) for cell in time_and_ratio(*pair)),
                f"{root_mean_square(errors):.2g}",
                len(errors),
                stated(done),
            ]
        )
    header = [
        "",
        "new process, nothing compiled",
        "÷ ours",
        "again in a session",
        "÷ ours",
        "error of ln Z, rms",
        "runs",
        "standard error stated",
    ]
    return table(header, rows)


def by_points(groups):
    kinds = ("model by points", "logp by points", "score by points", "sampling by points")
    rows = []
    for size, run in groups.get(kinds[-1], {}).items():
        times = [seconds(groups.get(kind, {}).get(size)) for kind in kinds]
        rows.append([number(size), *times, run["extra_info"]["stages"], *accuracy(run)])
    header = [
        "points",
        "build the model",
        "log density, 1 point",
        "log density, 2000 particles",
        "`ph.sample_smc`",
        "stages",
        "error of ln Z, rms",
        "standard error stated",
    ]
    return table(header, rows)


def by_particles(groups):
    rows = [
        [number(size), seconds(run), *accuracy(run)]
        for size, run in groups.get("sampling by particles", {}).items()
    ]
    header = ["particles", "`ph.sample_smc`", "error of ln Z, rms", "standard error stated"]
    return table(header, rows)


def by_experiments(groups):
    rows = []
    for size, run in groups.get("classification", {}).items():
        info = run["extra_info"]
        each = median(run) / int(size)
        rows.append(
            [
                number(size),
                seconds(run),
                duration(each),
                f"{info['right']:.0%}",
                f"{info['standard_error']:.2g}",
            ]
        )
    header = [
        "new experiments",
        "`ph.classify`",
        "each",
        "assigned to their class",
        "standard error of the log predictive, median",
    ]
    return table(header, rows)


def accuracy(run):
    return f"{root_mean_square(run['extra_info']['error']):.2g}", stated([run])


def stated(runs):
    """Root mean square of the standard errors that the method states."""
    errors = [error for run in runs for error in run["extra_info"]["standard_error"]]
    return DASH if None in errors else f"{root_mean_square(errors):.2g}"


def root_mean_square(values):
    return math.sqrt(sum(value**2 for value in values) / len(values))


def median(run):
    return run["stats"]["median"]


def time_and_ratio(run, ours):
    ratio = f"{median(run) / median(ours):.2g}" if run and ours else DASH
    return seconds(run), ratio


def seconds(run):
    return duration(median(run)) if run else DASH


def duration(time):
    """Three digits, in a unit of which there is at least one."""
    for unit, factor in (("s", 1), ("ms", 1e3), ("µs", 1e6)):
        if time * factor >= 1:
            break
    digits = max(0, 2 - math.floor(math.log10(time * factor)))
    return f"{time * factor:.{digits}f} {unit}"


def number(size):
    return f"{int(size):,}".replace(",", " ")


def table(header, rows):
    """Markdown table; all columns but the first are numbers."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


if __name__ == "__main__":
    options = argparse.ArgumentParser(description="Turn results of benchmarks into tables.")
    options.add_argument("results", type=Path, help="JSON file of pytest-benchmark")
    # Not Markdown by its name: Sphinx would make a page of it beside the one that includes it.
    options.add_argument("--out", type=Path, default=DOCS / "benchmark_tables.txt")
    given = options.parse_args()
    results = json.loads(given.results.read_text(encoding="utf-8"))
    given.out.write_text(tables(results) + "\n", encoding="utf-8")
    print(f"wrote {given.out}")
