"""Write files completely, or not at all."""

import hashlib
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

#: How the name of a file ends while it is written.
UNFINISHED = ".unfinished"


@contextmanager
def atomic_write(path: Path, *, once: bool = False) -> Iterator[Path]:
    """Yield a temporary file beside `path`, which replaces `path` when all of it is on the disk.

    Until then, and after a crash, `path` is the old file. If several processes write a file `once`
    at the same moment, the first one succeeds, and the others change nothing. Temporary files of
    `path` that killed processes left behind are removed.
    """
    # The name of the target, of any length, in the name of its temporary files.
    prefix = f".{hashlib.sha256(os.fsencode(path.name)).hexdigest()}"
    beside, file = _open_locked(path.parent, prefix)
    try:
        with file:
            for other in path.parent.glob(f"{prefix}.*{UNFINISHED}"):
                if other != beside:
                    _remove_if_abandoned(other)
            yield beside
            _on_disk(beside)
            if not (once and _linked(beside, path)):
                os.replace(beside, path)
        _on_disk(path.parent)
    finally:
        beside.unlink(missing_ok=True)


def remove_abandoned(folder: Path) -> None:
    """Remove the temporary files of a folder whose processes were killed."""
    for unfinished in folder.glob(f".*{UNFINISHED}"):
        _remove_if_abandoned(unfinished)


def _open_locked(folder: Path, prefix: str) -> tuple[Path, BinaryIO]:
    """Create a temporary file, and lock it until the process ends or closes it."""
    while True:
        beside = folder / f"{prefix}.{uuid.uuid4().hex}{UNFINISHED}"
        file = beside.open("xb")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Another writer may have removed the file before it was locked.
            if beside.exists():
                return beside, file
        except BlockingIOError:  # another writer is about to remove the file
            pass
        except (AttributeError, OSError):  # Windows, or a disk without locks
            return beside, file
        file.close()


def _remove_if_abandoned(unfinished: Path) -> None:
    """Remove a temporary file unless a living process holds its lock."""
    try:
        with unfinished.open("r+b") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            unfinished.unlink()
    except (AttributeError, OSError):
        pass


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
