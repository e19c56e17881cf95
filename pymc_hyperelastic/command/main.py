"""The command ``pymc-hyperelastic``."""

import os
import sys
import warnings
from typing import Any

# What a shell expects of a command that was interrupted: 128 and the number of the signal.
_INTERRUPTED = 130


def main() -> None:
    """Do what the command line asks for; what is wrong is said in one message."""
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
        app(standalone_mode=False)
    except KeyboardInterrupt:
        print("interrupted: the same command goes on from there", file=sys.stderr)
        sys.exit(_INTERRUPTED)
    except BrokenPipeError:
        # Nobody reads what is printed: what is computed was written before.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(_INTERRUPTED)
    except (OSError, TypeError, ValueError) as error:
        for note in getattr(error, "__notes__", ()):
            print(note, file=sys.stderr)
        sys.exit(f"error: {error}")
    except Exception as error:
        # What the command line itself has to say: no such option, a missing argument.
        if not hasattr(error, "show"):
            raise
        error.show()
        sys.exit(getattr(error, "exit_code", 2))


def _in_one_line(message: Any, *_: Any) -> None:
    print(f"warning: {message}", file=sys.stderr)
