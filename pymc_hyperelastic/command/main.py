"""The command ``pymc-hyperelastic``."""

import sys
import warnings
from typing import Any

_ADVICE = (
    "\nPyTensor stores compiled functions in this folder. Choose one that can be written: "
    "export PYTENSOR_FLAGS=base_compiledir=/a/folder"
)


def main() -> None:
    """Run the command line; print an error as one message."""
    try:
        from pymc_hyperelastic.command.commands import app
    except ModuleNotFoundError as error:
        if error.name not in ("typer", "jinja2"):
            raise
        sys.exit(
            f"the command line needs {error.name}, which is not installed: pip install typer jinja2"
        )
    warnings.showwarning = _in_one_line  # type: ignore[assignment]
    try:
        code = app(standalone_mode=False)
        # Typer catches Ctrl-C and returns 128 + SIGINT. A closed pipe ends the process with code 1.
        if code == 130:
            print("interrupted: repeat the command to continue", file=sys.stderr)
            sys.exit(code)
    except (OSError, TypeError, ValueError) as error:
        for note in getattr(error, "__notes__", ()):
            print(note, file=sys.stderr)
        advice = _ADVICE if "compiledir" in str(error) else ""
        sys.exit(f"error: {error}{advice}")
    except Exception as error:
        # An error of the command line itself: an unknown option, a missing argument.
        if not hasattr(error, "show"):
            raise
        error.show()
        sys.exit(getattr(error, "exit_code", 2))


def _in_one_line(message: Any, *_: Any) -> None:
    print(f"warning: {message}", file=sys.stderr)
