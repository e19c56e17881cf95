"""How long work keeps its finished parts: not at all, or in the store that the package registers.

The store itself is in ``io/``. This folder imports nothing of the package about files.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pymc_hyperelastic.evidence.smc import seed_sequence

#: A function of the name of a part and of how it is computed, which returns the part.
Remember = Callable[[str, Callable[[], Any]], Any]
#: Functions of a folder: the seed in its manifest, and how to keep parts of work with a manifest.
registered_stores: list[
    tuple[Callable[[Any], Any], Callable[[Any, Mapping[str, Any]], Remember]]
] = []


def compute_now[Result](_: str, compute: Callable[[], Result]) -> Result:
    """Compute a part, and keep it nowhere."""
    return compute()


def named(prefix: str, remember: Remember) -> Remember:
    """Return a `remember` that puts a prefix before the name of each part."""
    return lambda name, compute: remember(f"{prefix}-{name}", compute)


def remembering(folder: Any, manifest: Callable[[], Mapping[str, Any]]) -> Remember:
    """Return how to keep parts: in a folder, or not at all if `folder` is None.

    A Dataset or DataTree in the manifest stands for its checksum.
    """
    return compute_now if folder is None else registered_stores[0][1](folder, manifest())


def seed_kept(random_seed: Any, store: Any) -> np.random.SeedSequence:
    """Seed sequence of work that a store may hold: without a seed that which it was begun with."""
    if random_seed is None and store is not None:
        random_seed = registered_stores[0][0](store)
    return seed_sequence(random_seed)
