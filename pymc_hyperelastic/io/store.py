"""A folder that keeps the finished parts of a long computation, so that none is computed twice."""

import hashlib
import json
import warnings
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import xarray as xr

from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.evidence.keeping import registered_stores
from pymc_hyperelastic.io.atomic import UNFINISHED, atomic_write
from pymc_hyperelastic.io.checksum import digest_of
from pymc_hyperelastic.io.results import DamagedFile, open_file, save_result
from pymc_hyperelastic.messages import PACKAGE, in_one_line, shown
from pymc_hyperelastic.models.settings import OLDER_VERSION

# Format of the parts and of the manifest. A change of the numbers that the package computes for the
# same manifest, or of how a part is stored, needs another one.
_FORMAT = 2
_MANIFEST = "manifest.json"
#: Attribute of a part: the hash of the manifest of its store.
STORE = "store"
# Packages whose major and minor version may change the numbers.
_PACKAGES = ("pymc", "pytensor")


class OtherWork(ValueError):
    """A folder holds parts of another computation."""

    def __init__(self, folder: Path, differing: list[str]) -> None:
        self.said = f"the store {folder} holds other work: {'; '.join(differing)}. "
        super().__init__(f"{self.said}Give another folder, or the same data and settings")


@dataclass(frozen=True)
class Store:
    """Folder that keeps the finished parts of a long computation, and who computes the parts.

    After an interrupt or a kill, the same call with the same folder continues. The result does not
    depend on who computes it, nor on the size of the batches. A path given as a store means
    ``Store(path)``.

    Parameters
    ----------
    folder : str or Path
        The folder. It is created if it is missing; all workers of a `client` have to reach it.
    client : distributed.Client, optional
        Client of Dask, whose workers compute. Without one, this machine computes.
    cores : int, optional
        Number of processes of this machine: by default one for each core. With 1 the calling
        process computes.
    batch_size : int, default 64
        Number of specimens, or tests, in a batch. A worker computes one batch at a time, and keeps
        it in one file of the folder.

    Raises
    ------
    TypeError, ValueError
        If `client` is no client of Dask, `cores` or `batch_size` is no whole number above 0, or
        both `client` and `cores` are given.

    See Also
    --------
    fit_cohort, classify, open_result

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> classes = ph.open_result("pooled.nc")  # saved from the example of fit_classes
    >>> new = ph.select(data, specimen="S4", experiment=3)
    >>> store = ph.Store("classified", cores=1, batch_size=8)
    >>> found = ph.classify(new, classes, store=store, random_seed=2, progressbar=False)
    >>> ph.open_result(store).equals(found)
    True
    """

    folder: str | Path
    _: KW_ONLY
    client: Any = None
    cores: int | None = None
    batch_size: int = 64

    def __post_init__(self) -> None:
        object.__setattr__(self, "folder", Path(self.folder))
        check_count("batch_size", self.batch_size, 1)
        if self.cores is not None:
            check_count("cores", self.cores, 1)
        if self.client is None:
            return
        if not hasattr(self.client, "submit"):
            raise TypeError(
                f"client is {shown(self.client)}; expected a client of Dask: "
                "dask.distributed.Client(address)"
            )
        if self.cores is not None:
            raise ValueError(
                "cores is the number of processes of this machine, and the workers of client "
                "compute: give client or cores, not both"
            )

    def __fspath__(self) -> str:
        """Return the folder, so that a store is also a path."""
        return str(self.folder)


@dataclass(frozen=True)
class Part:
    """The file of a part and the hash of its store, as a worker needs them to write the part."""

    path: Path
    store: str
    """Hash of the manifest of the store."""

    def save(self, result: xr.Dataset | xr.DataTree) -> None:
        """Write the part, with a note of the store to which it belongs."""
        result = result.copy()
        result.attrs[STORE] = self.store
        save_result(result, self.path)


class Parts:
    """Parts of a long computation in a folder, each of which is complete or not there.

    The folder holds a manifest, which describes the computation, and one netCDF file for each part.
    It is created if it is missing. After an interrupt or a kill, the same call continues.

    Parameters
    ----------
    folder : str or Path
        Folder of the parts.
    manifest : mapping
        All that decides the result, in types of JSON: the computation, settings, the seed. A
        Dataset or a DataTree becomes its checksum. The format of results and the versions of PyMC
        and PyTensor are added.

    Raises
    ------
    ValueError
        If the folder holds something else, or parts of another computation.
    OSError
        If it cannot be written.
    """

    def __init__(self, folder: str | Path, manifest: Mapping[str, Any]) -> None:
        self.folder = Path(folder)
        versions = {name: ".".join(version(name).split(".")[:2]) for name in _PACKAGES}
        manifest = json.loads(json.dumps(manifest, default=_checksum))
        manifest = {"format": _FORMAT, **manifest, "versions": versions}
        there = manifest_of(self.folder, missing=True)
        if there is None:
            _check_empty(self.folder)
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                with atomic_write(self.folder / _MANIFEST, once=True) as path:
                    path.write_text(json.dumps(manifest, indent=1, ensure_ascii=False), "utf-8")
            except OSError as error:
                raise type(error)(
                    f"the store {self.folder} cannot be made: {error.strerror or error}"
                ) from error
            # Another process may have made it at the same moment.
            there = manifest_of(self.folder)
        if differing := differences(there, manifest):
            raise OtherWork(self.folder, differing)
        self.hash = hash_of(manifest)

    def part(self, name: str) -> Path:
        """Return the path of a part; ValueError if its name would lead to another folder."""
        if not name or name != Path(name).name or "\\" in name or name.startswith("."):
            raise ValueError(f"a part cannot be called {name!r}: expected letters, and no path")
        return self.folder / f"{name}.nc"

    def remember[Result: (xr.Dataset, xr.DataTree)](
        self, name: str, compute: Callable[[], Result]
    ) -> Result:
        """Return the part of this name; compute and keep it if the store does not have it."""
        kept = self.kept(name)
        if kept is not None:
            return kept
        result = compute()
        self.of_part(name).save(result)
        return result

    def of_part(self, name: str) -> Part:
        """Return the absolute path of a part and the hash of this store."""
        return Part(self.part(name).absolute(), self.hash)

    def kept(self, name: str) -> Any:
        """Return the part of this name; None if it is missing or damaged.

        A damaged part is renamed, and a warning names it. All other errors are raised: those of the
        disk, and ValueError for a part of another store.
        """
        path = self.part(name)
        try:
            result = open_file(path)
        except FileNotFoundError:
            return None
        except DamagedFile as error:
            aside = set_aside(path)
            warnings.warn(
                f"{error}. The file was renamed to {aside.name}, and the part is computed again",
                skip_file_prefixes=(PACKAGE,),
            )
            return None
        check_store(result, self.hash, path)
        return result


def set_aside(path: Path) -> Path:
    """Rename a damaged file, to a name that is free."""
    number = 1
    while (aside := path.with_name(f"{path.name}.damaged-{number}")).exists():
        number += 1
    return path.rename(aside)


def _checksum(data: Any) -> dict[str, str]:
    """Return what stands for data in a manifest; TypeError if it is something else."""
    if not isinstance(data, xr.Dataset | xr.DataTree):
        raise TypeError(f"a manifest cannot hold {shown(data)}")
    return {"sha256": digest_of(data)}


def hash_of(manifest: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a manifest, by which its parts are recognised."""
    return hashlib.sha256(json.dumps(manifest, sort_keys=True).encode()).hexdigest()


def check_store(part: xr.Dataset | xr.DataTree, expected: str, path: Path) -> None:
    """Remove the note of its store from a part; ValueError if it was computed for another store."""
    found = part.attrs.pop(STORE, None)
    if found != expected:
        raise ValueError(
            f"{path} belongs to another store: its manifest has the hash {str(found)[:12]}, "
            f"that of {path.parent} has {expected[:12]}; data, settings or versions differ. "
            "Remove the file, or give another folder"
        )


def seed_in(folder: str | Path) -> Any:
    """Return the seed in the manifest of a store; None if the store does not exist."""
    manifest = manifest_of(Path(folder), missing=True)
    seed = None if manifest is None else manifest.get("random_seed")
    for entry in seed if isinstance(seed, list) else [seed]:
        if entry is not None and (type(entry) is not int or entry < 0):
            raise ValueError(
                f"the manifest of {folder} has the random_seed {shown(seed)}; expected whole "
                "numbers: it is damaged"
            )
    return seed


def manifest_of(folder: Path, *, missing: bool = False) -> dict[str, Any] | None:
    """Return the manifest of a store; None if the store does not exist and may be `missing`."""
    path = folder / _MANIFEST
    try:
        manifest = json.loads(path.read_text("utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        if missing:
            return None
        raise FileNotFoundError(
            f"{folder} is no store: it has no {_MANIFEST}; ph.fit_cohort and "
            "ph.classify(..., store=...) make one"
        ) from None
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is damaged: it is no JSON: {in_one_line(error)}") from None
    found = manifest.get("format") if isinstance(manifest, dict) else None
    if found != _FORMAT:
        older = f"it has format 1, and needs {OLDER_VERSION}" if found == 1 else "it is damaged"
        raise ValueError(f"{path} is no manifest of a store of format {_FORMAT}: {older}")
    return manifest


def differences(there: Any, now: Any, where: str = "") -> list[str]:
    """Return the differences of two manifests, in words."""
    if isinstance(there, dict) and isinstance(now, dict):
        return [
            said
            for key in {**there, **now}
            for said in differences(
                there.get(key), now.get(key), f"{where}, {key}" if where else key
            )
        ]
    if there == now:
        return []
    if all(
        isinstance(entry, list) and entry and isinstance(entry[0], dict) for entry in (there, now)
    ):
        return differences(dict(enumerate(there, 1)), dict(enumerate(now, 1)), where)
    if where.endswith("fingerprint"):
        return [
            f"{where.removesuffix(', fingerprint')} has another formula there than here: its "
            f"stresses are {there} there and {now} here"
        ]
    if where.endswith("sha256"):
        return [f"{where.removesuffix(', sha256')} are not the same"]
    return [f"{where} is {there!r} there and {now!r} here"]


def _check_empty(folder: Path) -> None:
    """Raise unless a store can be made here."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"the store {folder} must be a folder, and it is a file")
    names = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    # A process that is killed while it writes leaves an unfinished file, which nothing reads.
    strangers = [name for name in names if not name.endswith(UNFINISHED)][:3]
    # Another process may have made the store since this one has looked for a manifest.
    if strangers and not (folder / _MANIFEST).exists():
        raise ValueError(
            f"the folder {folder} is no store, and not empty: it holds {', '.join(strangers)}. "
            "Give a folder of its own"
        )


registered_stores.append((seed_in, lambda folder, manifest: Parts(folder, manifest).remember))
