"""Files that are whole, or not there."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: How the name of a file ends while it is written.
UNFINISHED = ".unfinished"


@contextmanager
def written_whole(path: Path, *, once: bool = False) -> Iterator[Path]:
    """A file to be written beside `path`, whose place it takes when all of it is on the disk.

    Whoever looks meanwhile, or after a crash, finds what was there before. Of several processes
    that write a file `once` at the same moment, the first one succeeds; the others change nothing.
    """
    beside = path.with_name(f".{uuid.uuid4().hex}{UNFINISHED}")
    try:
        yield beside
        _on_disk(beside)
        if not (once and _linked(beside, path)):
            os.replace(beside, path)
        _on_disk(path.parent)
    finally:
        beside.unlink(missing_ok=True)


def _linked(file: Path, path: Path) -> bool:
    """Give a file a second name, unless the name is taken; False on disks without links."""
    try:
        os.link(file, path)
    except FileExistsError:
        pass
    except OSError:
        return False
    return True


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
