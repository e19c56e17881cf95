"""Store the output and figures of a long example: ``python docs/store_example.py NAME``.

The page of the example in the gallery shows them, with the date of the run. With
``--folder FOLDER``, an interrupted run continues from the files in that folder.
"""

import argparse
import datetime
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).parent
EXAMPLES = DOCS.parent / "examples"


def store(name: str, place: Path | None) -> None:
    """Run an example, and store its output and figures."""
    kept = DOCS / "stored" / name
    with tempfile.TemporaryDirectory() as empty:
        folder = place or Path(empty)
        done = subprocess.run(
            [sys.executable, str(EXAMPLES / f"{name}.py")],
            cwd=folder,
            env=os.environ | {"MPLBACKEND": "agg", "PYTHONPATH": str(EXAMPLES)},
            stdout=subprocess.PIPE,
            encoding="utf-8",
            check=True,
        )
        shutil.rmtree(kept, ignore_errors=True)
        kept.mkdir(parents=True)
        for figure in sorted(folder.rglob("*.png")):
            shutil.copy(figure, kept)
    day = datetime.date.today()
    bars = re.compile(r"━|─{9}|^ +Progress  |^ +$")  # of progress
    lines = [line for line in done.stdout.splitlines() if not bars.search(line)]
    (kept / "output.txt").write_text("\n".join([f"Run on {day}", *lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("names", nargs="+")
    options.add_argument("--folder", type=Path)
    args = options.parse_args()
    for example in args.names:
        store(example, args.folder)
