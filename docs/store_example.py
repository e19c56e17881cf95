"""Keep what an example that takes long prints and draws: ``python docs/store_example.py NAME``.

Its page in the gallery shows that, and the day on which it was run. In a folder that is named,
``--folder FOLDER``, it goes on with what it has kept there.
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
    """Run an example, and keep its output and its figures."""
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
