"""Write files completely, or not at all."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: How the name of a file ends while it is written.
UNFINISHED = ".unfinished"


@contextmanager
def written_whole(path: Path, *, once: bool = False) -> Iterator[Path]:
    """Yield a temporary file beside `path`, which replaces `path` when all of it is on the disk.

    Until then, and after a crash, `path` is the old file. If several processes write a file `once`
    at the same moment, the first one succeeds, and the others change nothing.
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
    """Wait until the data are on the disk: a power cut could else leave an empty file."""
    try:
        handle = os.open(path, os.O_RDONLY)
    except PermissionError:  # Windows opens no folders
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
