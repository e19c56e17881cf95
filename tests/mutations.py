"""Measure how many small mistakes in the package the tests find.

``python tests/mutations.py list`` prints mutations of the package, drawn with a fixed seed and
spread over its folders and over five kinds of mistakes. ``python tests/mutations.py run`` makes
each in a copy of the package and runs the first tier until a test fails. For each mutation that
survives, it runs the second tier. The table is written to ``results/mutations.json``; an
interrupted run continues. This takes one to three hours; run it before a release.
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
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "pymc_hyperelastic"
RESULTS = ROOT / "results" / "mutations.json"
SEED = 20261128  # any seed will do; the list in the documentation was made with this one
COUNT = 60
KINDS = ("sign", "constant", "comparison", "off by one", "dropped term")
# A constant with a name is a setting of a method: a correct method gives right results with another
# value too, so that a changed setting is no mistake that a test could find.
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


def is_found(mutation: Mutation, tier: str) -> str:
    """Return the first test that fails, or "" if all pass."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / ROOT.name
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*NOT_COPIED))
        mutation.apply(copy / PACKAGE.name)
        environment = os.environ | {"PYTHONPATH": str(copy), "OMP_NUM_THREADS": "1"}
        # The tests of the same folder first: they find most mistakes.
        own = Path("tests") / mutation.folder
        rest = ["--doctest-modules", "tests", PACKAGE.name, f"--ignore={own}"]
        rest += ["--ignore=tests/benchmarks"]
        for paths in ([str(own)] if (copy / own).is_dir() else [], rest):
            if not paths:
                continue
            command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "auto", "-m", tier]
            command += ["-p", "no:benchmark", "-p", "no:cacheprovider", *paths]
            done = subprocess.run(
                command, cwd=copy, env=environment, capture_output=True, text=True, check=False
            )
            if done.returncode not in SURVIVED:
                lines = done.stdout.splitlines()
                failed = [x for x in lines if x.startswith(("FAILED", "ERROR"))]
                return failed[0][:200] if failed else lines[-1][:200] if lines else "crash"
    return ""


def run(count: int, seed: int) -> None:
    """Hold the tests against each mutation and store what found it."""
    RESULTS.parent.mkdir(exist_ok=True)
    found = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    mutations = chosen(count, seed)
    for tier, marks in (("first", "not deep"), ("second", "deep and not long")):
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
