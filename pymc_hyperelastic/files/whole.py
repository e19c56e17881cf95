"""Files that are whole, or not there."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A file to be written beside `path`, whose place it takes when all of it is on the disk.

    Whoever looks meanwhile, or after a crash, finds what was there before.
    """
    beside = path.with_name(f".{uuid.uuid4().hex}.unfinished")
    try:
        yield beside
        _on_disk(beside)
        os.replace(beside, path)
        _on_disk(path.parent)
    finally:
        beside.unlink(missing_ok=True)


def _on_disk(path: Path) -> None:
    """Wait until the disk has what was written: a power cut may else leave a name without data."""
    try:
        handle = os.open(path, os.O_RDONLY)
    except PermissionError:  # Windows opens no folders
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
