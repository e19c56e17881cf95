"""Measure how many small mistakes in the package the tests find.

``python tests/mutations.py list`` prints mutations of the package, drawn with a fixed seed and
spread over its folders and over five kinds of mistakes. ``python tests/mutations.py run`` first
runs the first tier and notes which files of tests execute which lines of the package. It then makes
each mutation in a copy of the package, and runs the files that execute its line until a test fails.
For each mutation that survives, it runs the second-tier tests of the same folder and the golden
numbers. The table is written to ``results/mutations.json``; an interrupted run continues. This
takes about an hour; run it before a release.
"""

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Generator, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from types import CodeType

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "pymc_hyperelastic"
RESULTS = ROOT / "results" / "mutations.json"
# Lines of the package that each file of tests executes, recorded by each process.
LINES = ROOT / "results" / "lines"
SEED = 20261128  # any seed will do
COUNT = 60
KINDS = ("sign", "constant", "comparison", "off by one", "dropped term")
# Named constants are settings of a method. They are not mutated: a correct method gives right
# results with another value too.
FLIPPED = {
    ast.Lt: ">",
    ast.Gt: "<",
    ast.LtE: ">",
    ast.GtE: "<",
    ast.Eq: "!=",
    ast.NotEq: "==",
}
OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}
NOT_COPIED = (".venv", ".git", ".ci", ".fits", "results", "_build", "__pycache__", ".pytensor")
# Lines that a statement takes at most, of which only the first may be noted.
_LINES_OF_STATEMENT = 3
FIRST, SECOND = "not deep", "deep and not long"
# Pytest's exit codes for "all passed" and "no test was collected".
SURVIVED = (0, 5)


@dataclass(frozen=True)
class Mutation:
    """A piece of source code and its replacement."""

    kind: str
    path: str
    line: int
    start: int
    end: int
    old: str
    new: str

    @property
    def folder(self) -> str:
        """Folder of the package, the unit over which mutations are spread."""
        return Path(self.path).parts[0]

    def apply(self, package: Path) -> None:
        """Change a copy of the package."""
        path = package / self.path
        source = path.read_bytes()
        path.write_bytes(source[: self.start] + self.new.encode() + source[self.end :])

    def __str__(self) -> str:
        old, new = (" ".join(text.split()) for text in (self.old, self.new))
        return f"{self.path}:{self.line}: {self.kind}: {old} -> {new}"


def mutations_of(path: Path) -> Iterator[Mutation]:
    """Yield every mutation of a module."""
    source = path.read_bytes()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def mutation(kind: str, node: ast.expr, new: str) -> Mutation:
        start = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        old = source[start:end].decode()
        return Mutation(kind, str(path.relative_to(PACKAGE)), node.lineno, start, end, old, new)

    for node, parent in _computing_nodes(ast.parse(source)):
        text = ast.unparse(node)
        if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS and not _is_sequence(node):
            left, right = (f"({ast.unparse(side)})" for side in (node.left, node.right))
            if isinstance(node.op, ast.Add | ast.Sub):
                other = "-" if isinstance(node.op, ast.Add) else "+"
                yield mutation("sign", node, f"({left} {other} {right})")
            yield mutation("dropped term", node, left)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            if not isinstance(node.operand, ast.Constant):
                yield mutation("sign", node, f"({ast.unparse(node.operand)})")
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in FLIPPED:
            if len(node.ops) == 1:
                sides = ast.unparse(node.left), ast.unparse(node.comparators[0])
                yield mutation("comparison", node, f"({FLIPPED[type(node.ops[0])].join(sides)})")
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            if isinstance(parent, ast.Slice | ast.Subscript) or _is_one_beside_a_count(
                node, parent
            ):
                yield mutation("off by one", node, f"({text} + 1)")
            elif isinstance(parent, ast.BinOp):
                changed = f"({text} + 1)" if type(node.value) is int else f"({text} * 1.5)"
                yield mutation("constant", node, changed)


def _computing_nodes(tree: ast.Module) -> Iterator[tuple[ast.expr, ast.AST]]:
    """Yield the expressions of functions that compute, without messages, types and defaults."""

    def visit(node: ast.AST, parent: ast.AST, inside: bool) -> Iterator[tuple[ast.expr, ast.AST]]:
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.arguments | ast.Assert):
            return
        if inside and isinstance(node, ast.expr):
            yield node, parent
        inside = inside or isinstance(node, ast.FunctionDef)
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "decorator_list"):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from visit(child, node, inside)

    yield from visit(tree, tree, False)


def _is_sequence(node: ast.BinOp) -> bool:
    """Return True where text or lists are joined."""
    joined = ast.JoinedStr | ast.List | ast.Tuple | ast.ListComp | ast.Dict | ast.Set
    return any(
        isinstance(side, joined) or (isinstance(side, ast.Constant) and isinstance(side.value, str))
        for side in (node.left, node.right)
    )


def _is_one_beside_a_count(node: ast.Constant, parent: ast.AST) -> bool:
    return (
        node.value == 1
        and type(node.value) is int
        and isinstance(parent, ast.BinOp)
        and isinstance(parent.op, ast.Add | ast.Sub)
        and parent.right is node
    )


def chosen(count: int, seed: int) -> list[Mutation]:
    """Draw mutations: folders take turns by their share of the code, kinds in a fixed order."""
    generator = random.Random(seed)
    pool: dict[str, dict[str, list[Mutation]]] = {}
    lines: dict[str, int] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        folder = path.relative_to(PACKAGE).parts[0]
        if folder.endswith(".py"):
            continue
        lines[folder] = lines.get(folder, 0) + len(path.read_text(encoding="utf-8").splitlines())
        kinds = pool.setdefault(folder, {kind: [] for kind in KINDS})
        for mutation in mutations_of(path):
            kinds[mutation.kind].append(mutation)
    for kinds in pool.values():
        for mutations in kinds.values():
            generator.shuffle(mutations)
    found: list[Mutation] = []
    taken = dict.fromkeys(pool, 0)
    while len(found) < count:
        # The folder that has the fewest mutations for its lines of code.
        folder = min(pool, key=lambda name: ((taken[name] + 1) / lines[name], name))
        mutations = pool[folder][KINDS[(taken[folder] + list(pool).index(folder)) % len(KINDS)]]
        taken[folder] += 1
        if mutations:
            found.append(mutations.pop())
    return found


class ExecutedLines:
    """Plugin of pytest that records which lines of the package the tests of each file execute.

    The lines that make a stored fit belong to every file that reads the fit.
    """

    def __init__(self) -> None:
        self._lines: dict[str, set[str]] = {}
        self._current: set[str] = set()
        sys.monitoring.use_tool_id(sys.monitoring.COVERAGE_ID, "mutations")
        line = sys.monitoring.events.LINE
        sys.monitoring.register_callback(sys.monitoring.COVERAGE_ID, line, self._execute)
        sys.monitoring.set_events(sys.monitoring.COVERAGE_ID, line)
        import fits

        self._fits, self._stored, fits.stored = fits, fits.stored, self._read

    def _execute(self, code: CodeType, line: int) -> object:
        if code.co_filename.startswith(str(PACKAGE)):
            self._current.add(f"{Path(code.co_filename).relative_to(PACKAGE)}:{line}")
        return sys.monitoring.DISABLE

    def _read(self, name: str) -> Path:
        self._current.add(f"fit {name}")
        outside, self._current = self._current, self._lines.setdefault(f"fit {name}", set())
        sys.monitoring.restart_events()
        try:
            return self._stored(name)
        finally:
            self._current = outside

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """Collect the lines that a test and its fixtures execute."""
        self._current = self._lines.setdefault(item.location[0], set())
        # Otherwise a fit that is in memory is not read again.
        self._fits._opened.cache_clear()
        sys.monitoring.restart_events()
        return (yield)

    def pytest_sessionfinish(self) -> None:
        """Write what was collected."""
        LINES.mkdir(parents=True, exist_ok=True)
        lines = {name: sorted(executed) for name, executed in self._lines.items()}
        (LINES / f"{os.getpid()}.json").write_text(json.dumps(lines))


def pytest_configure(config: pytest.Config) -> None:
    """Take part in a run of pytest that loads this module with ``-p mutations``."""
    if hasattr(config, "workerinput"):
        config.pluginmanager.register(ExecutedLines())


@cache
def files_by_line() -> dict[str, set[str]]:
    """Return the files of tests that execute each line of the package."""
    if not LINES.exists():
        shutil.rmtree(ROOT / "tests" / ".fits", ignore_errors=True)
        tests = ["-m", FIRST, "--ignore=tests/benchmarks", "tests"]
        run_tests(ROOT, ["-p", "mutations", *tests])
    found: dict[str, set[str]] = {}
    executed = [json.loads(path.read_text()) for path in LINES.iterdir()]
    fits = [(n, line) for one in executed for n in one if n[:4] == "fit " for line in one[n]]
    for one in executed:
        for file, lines in one.items():
            if file.startswith("fit "):
                continue
            more = [line for name, line in fits if name in lines]
            for line in [*lines, *more]:
                found.setdefault(line, set()).add(file)
    return found


def run_tests(folder: Path, arguments: list[str]) -> subprocess.CompletedProcess:
    """Run pytest in all processors."""
    command = [sys.executable, "-m", "pytest", "-q", "-n", "auto"]
    command += ["-p", "no:benchmark", "-p", "no:cacheprovider", *arguments]
    paths = os.pathsep.join([str(folder), str(folder / "tests")])
    environment = os.environ | {"PYTHONPATH": paths, "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def is_found(mutation: Mutation, tier: str) -> str:
    """Return the first test that fails, or "" if all pass."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / ROOT.name
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*NOT_COPIED))
        mutation.apply(copy / PACKAGE.name)
        own = copy / "tests" / mutation.folder
        paths = {str(own.relative_to(copy))} if own.is_dir() else set()
        if tier == FIRST:
            # A part of a statement may count for the line on which the statement begins.
            lines = range(mutation.line - _LINES_OF_STATEMENT, mutation.line + 1)
            executed = [files_by_line().get(f"{mutation.path}:{line}", set()) for line in lines]
            paths = paths.union(*executed)
        else:
            paths.add("tests/golden")
        done = run_tests(copy, ["-x", "-m", tier, *sorted(paths)])
        if done.returncode not in SURVIVED:
            lines = done.stdout.splitlines()
            failed = [x for x in lines if x.startswith(("FAILED", "ERROR"))]
            return failed[0][:200] if failed else lines[-1][:200] if lines else "crash"
    return ""


def run(count: int, seed: int) -> None:
    """Run the tests on each mutation and store which test failed."""
    RESULTS.parent.mkdir(exist_ok=True)
    found = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    mutations = chosen(count, seed)
    for tier, marks in (("first", FIRST), ("second", SECOND)):
        for mutation in mutations:
            entry = found.setdefault(str(mutation), {"mutation": asdict(mutation)})
            if tier not in entry and not (tier == "second" and entry["first"]):
                entry[tier] = is_found(mutation, marks)
                RESULTS.write_text(json.dumps(found, indent=1))
                print(f"{tier}: {mutation}\n    {entry[tier] or 'SURVIVES'}", flush=True)
    entries = [found[str(mutation)] for mutation in mutations]
    first = sum(bool(entry["first"]) for entry in entries)
    both = sum(bool(entry["first"] or entry.get("second")) for entry in entries)
    print(f"found: {first} of {count} by the first tier, {both} of {count} by both")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=("list", "run"))
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--seed", type=int, default=SEED)
    arguments = parser.parse_args()
    if arguments.command == "list":
        print(*chosen(arguments.count, arguments.seed), sep="\n")
    else:
        run(arguments.count, arguments.seed)
