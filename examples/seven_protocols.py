"""
Seven protocols: predict each from the six others
=================================================

Laboratories test a vessel by seven protocols: inflation at three axial stretches, and axial
extension at four held pressures. Each of these **measured** tubes, the vaginal walls of eight mice
before and after elastase, was. Every protocol is left out in turn, a law is fitted to the pressures
and axial forces of the six others, and what was measured in the one left out is predicted for each
specimen: the outer diameter at its pressures and axial stretches, and the axial force.

**What this can and cannot show.** Three of the seven protocols lie between two of their kind, and
all are of the same specimen: an error says how well a law couples two directions and two signals,
not how well it speaks of another animal. The comparison needs no material at all: what lies on the
straight line through the two neighbouring protocols. A law has to earn its place against that.

**What was found.** Over all seven protocols the median error of the diameter is 147 µm for Ogden's
solid, 152 µm for the two families of fibres of Holzapfel, Gasser and Ogden, 72 µm for four families
of fibres, and 24 µm on the straight line; of the force it is 6.6, 3.8, 1.7 and 0.6 mN. None of the
laws comes near the line.

It is the laws that stand in the way, not what they had to learn from: fitted to all seven protocols
they still err by 127, 131 and 60 µm, and by 6.2, 3.7 and 1.6 mN. In the extension tests at the two
higher pressures four families err by 23 and 26 µm, where the line has 13 and 24. Each of these two
left out, they err by 27 and 38 µm, where the others have 55 to 194; the line, 13 and 24, is still
nearer. What four families do not follow either is the wall at the smallest pressure, 2 mmHg in the
first of the extension tests: 231 µm, though it was fitted to them, and 286 µm where it was left
out. Whether it is quite unfolded there nobody measured. The second extension test, left out, gives
84 µm, where the line has 22, and the inflation tests by rising axial stretch give 96, 53 and 60,
where it has 40, 20 and 42.

The measurements are those of A. R. Akintunde et al., Journal of Biomechanical Engineering 141
(2019) 021011. They are not part of this package. They are read by :download:`murine_tables.py`,
which has to lie beside this script and says where it looks for the tables.
"""

# sphinx_gallery_thumbnail_path = "stored/seven_protocols/errors.png"

import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import murine_tables
import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr

import pymc_hyperelastic as ph

DRAWS = 500
FITTED_ALONE = False  # whether none is left out: how well laws follow all seven
SPECIMENS = None  # names of some of them, or all
OUT = Path("results/seven_protocols")  # where results go
OUT.mkdir(parents=True, exist_ok=True)

# %%
# What was chosen before anything was predicted
# ---------------------------------------------
# Points of inflation tests below 3.5 mmHg are left out: there the wall, which lies folded at rest,
# is unfolding. The extension tests at about 2 mmHg are kept: they are one of the seven, in which
# the wall stays unfolded as it shortens. Thickness and opening angle are taken as known.
#
# Ogden's solid is isotropic; the other two laws have fibres. Specimens of a group differ, and learn
# from each other what is usual: priors are the package's own, of the group's distribution. The
# sizes of the errors of pressures and of forces are inferred of each specimen, within a factor of
# ten of 1 mmHg and of 1 mN, and no weight is set by hand. The transducer was not set to zero before
# each test: its offset, 20 mN or so, is integrated out. For the same reason only the shape of the
# force can be predicted: from the error of a protocol's forces their mean is taken away.
data, geometry = murine_tables.read(extended=True)
if SPECIMENS:
    data = ph.select(data, specimen=SPECIMENS)
groups = dict(zip(geometry["specimen"], geometry["group"], strict=True))
specimens = [name for name in geometry["specimen"] if name in set(data["specimen"].values)]
INFLATION = ["test1", "test2", "test3"]
EXTENSION = ["force_length1", "force_length2", "force_length3", "force_length4"]
PROTOCOLS = INFLATION + EXTENSION
LAWS = [ph.Ogden(), ph.HolzapfelGasserOgden(), ph.FourFiber()]  # the last: 5 minutes a class
FACTOR_TEN = np.log(10) / 2
LIKELIHOOD = ph.Gaussian(
    pressure_sd=pm.LogNormal.dist(np.log(ph.mmHg), FACTOR_TEN),
    force_sd=pm.LogNormal.dist(np.log(1.0), FACTOR_TEN),
    force_offset_sd=20.0,
)
SIGNALS = ["outer_diameter", "axial_force"]


def predicted(tree: xr.DataTree, specimen: str, left_out: pd.DataFrame) -> pd.DataFrame:
    """Medians of outer diameter (mm) and axial force (mN) of a specimen at points of a protocol."""
    tube = ph.Tube(axial_stretch=left_out["axial_stretch"].values)
    at = ph.Conditions(left_out["pressure"].values, tube=tube)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*(reach|extrapolat|measured)")
        try:
            found = ph.tube_properties(tree, at, specimen=specimen)
        except ValueError as error:
            if "no draw reaches" not in str(error):
                raise
            if len(left_out) == 1:
                return pd.DataFrame(np.nan, left_out.index, SIGNALS)
            rows = (left_out.iloc[[row]] for row in range(len(left_out)))
            return pd.concat([predicted(tree, specimen, row) for row in rows])
    of_draws = 2 * found["outer_radius"], found["axial_force"]
    medians = [x.median(dim=("chain", "draw")).values for x in of_draws]
    return pd.DataFrame(dict(zip(SIGNALS, medians, strict=True)), left_out.index)


def between(points: pd.DataFrame, protocol: str) -> pd.DataFrame:
    """The same without a law, on the straight line through the two neighbouring protocols.

    Inflation tests are compared at the same pressure, along the axial stretch, and extension tests
    at the same axial stretch, along the pressure.
    """
    kind, along, across = (
        (INFLATION, "pressure", "axial_stretch")
        if protocol in INFLATION
        else (EXTENSION, "axial_stretch", "pressure")
    )
    place, left_out = kind.index(protocol), points[points["experiment"] == protocol]
    near = sorted((p for p in kind if p != protocol), key=lambda p: abs(kind.index(p) - place))
    sides = []
    for name in near[:2]:
        side = points[points["experiment"] == name].sort_values(along)
        at = {x: np.interp(left_out[along], side[along], side[x]) for x in (across, *SIGNALS)}
        sides.append(pd.DataFrame(at, left_out.index))
    share = (left_out[across] - sides[0][across]) / (sides[1][across] - sides[0][across])
    return pd.DataFrame(
        {x: (1 - share) * sides[0][x] + share * sides[1][x] for x in SIGNALS}, left_out.index
    )


def table_of(specimen: str) -> pd.DataFrame:
    """Points of a specimen, with the protocol and the axial stretch of each."""
    own = ph.select(data, specimen=specimen)
    frame = pd.DataFrame({x: own[x].values for x in ("pressure", *SIGNALS)})
    of_point = own["axial_stretch"].values, own["experiment"].values[own["test"].values]
    return frame.assign(axial_stretch=of_point[0], experiment=of_point[1])


# %%
# Leave each protocol out, and none
# ---------------------------------
# What has been found is kept: a run that was interrupted goes on.
NOBODY, FITTED = "(between)", ", fitted"
points = {specimen: table_of(specimen) for specimen in specimens}
known = OUT / "errors.csv"
rows = [pd.read_csv(known)] if known.exists() else []


def lacks(law: str, protocol: str) -> bool:
    """Whether a protocol is still to be predicted by a law."""
    return not any(((of["law"] == law) & (of["protocol"] == protocol)).any() for of in rows)


def add_errors(law: str, protocol: str, specimen: str, values: pd.DataFrame) -> None:
    """Keep what a prediction errs by; of forces less their mean."""
    error = values - points[specimen].loc[values.index, SIGNALS]
    error["axial_force"] -= error["axial_force"].mean()
    rows.append(error.assign(law=law, protocol=protocol, specimen=specimen))


def fitted_to(energy: ph.StrainEnergy, protocols: list[str]) -> xr.DataTree:
    """Classes of these protocols."""
    kept = ph.select(data, experiment=protocols)
    there = dict.fromkeys(groups[name] for name in specimens)
    return ph.fit_classes(
        energy,
        {group: ph.select(kept, group=group) for group in there},
        LIKELIHOOD,
        variability="specimen",
        draws=DRAWS,
        chains=1,
        random_seed=1,
        store=OUT / f"store of {energy.name}, {' '.join(protocols)}",
    )


def add_predicted(law: str, classes: xr.DataTree, protocol: str) -> None:
    """Keep what the classes' specimens err by in a protocol."""
    for specimen in specimens:
        there = points[specimen][points[specimen]["experiment"] == protocol]
        add_errors(law, protocol, specimen, predicted(classes[groups[specimen]], specimen, there))


for protocol in PROTOCOLS if lacks(NOBODY, PROTOCOLS[0]) else []:
    for specimen in specimens:
        add_errors(NOBODY, protocol, specimen, between(points[specimen], protocol))
for energy in LAWS:
    # Fitted to all seven, a law says how well it can follow them at all.
    if lacks(f"{energy.name}{FITTED}", PROTOCOLS[0]):
        print(f"{energy.name}: all seven", flush=True)
        classes = fitted_to(energy, PROTOCOLS)
        for protocol in PROTOCOLS:
            add_predicted(f"{energy.name}{FITTED}", classes, protocol)
        pd.concat(rows).to_csv(known, index=False)
    for protocol in PROTOCOLS if not FITTED_ALONE else []:
        if not lacks(energy.name, protocol):
            continue
        print(f"{energy.name}: all but {protocol}", flush=True)
        classes = fitted_to(energy, [p for p in PROTOCOLS if p != protocol])
        add_predicted(energy.name, classes, protocol)
        pd.concat(rows).to_csv(known, index=False)
errors = pd.concat(rows)

# %%
# The numbers
# -----------
# Medians over the points of all specimens. Points to which no draw reaches count as the worst.
laws = [NOBODY]
for energy in LAWS:
    laws += [f"{energy.name}{FITTED}", *([] if FITTED_ALONE else [energy.name])]
size = errors.assign(
    **{
        "diameter, µm": 1e3 * errors["outer_diameter"].abs().fillna(np.inf),
        "force, mN": errors["axial_force"].abs().fillna(np.inf),
    }
)
for name in ("diameter, µm", "force, mN"):
    table = size.pivot_table(name, "protocol", "law", "median").loc[PROTOCOLS, laws]
    table.loc["all"] = size.groupby("law")[name].median()[laws]
    print(f"\nMedian error of {name}")
    print(table.round(1).to_string())
    table.to_csv(OUT / f"{name.split(',')[0]}.csv")
each = size.pivot_table("diameter, µm", "specimen", "law", "median")[laws]
print("\nMedian error of diameter, µm, by specimen")
print(each.round(1).to_string())

# %%
# The figure
# ----------
names = [energy.name for energy in LAWS]
figure, axes = plt.subplots(2, 1, figsize=(9, 7), sharex=True, layout="constrained")
for ax, name in zip(axes, ("diameter, µm", "force, mN"), strict=True):
    for number, law in enumerate(laws):
        of_law = size[size["law"] == law].groupby("protocol")[name]
        middle, low, high = (of_law.quantile(q)[PROTOCOLS] for q in (0.5, 0.25, 0.75))
        place = np.arange(len(PROTOCOLS)) + 0.7 / len(laws) * (number - (len(laws) - 1) / 2)
        color = "0.5" if law == NOBODY else f"C{names.index(law.removesuffix(FITTED))}"
        ax.vlines(place, low, high, color=color, alpha=0.6)
        ax.plot(place, middle, "s" if law.endswith(FITTED) else "o", color=color, label=law)
    ax.set(ylabel=f"error of {name}", yscale="log")
axes[1].set_xticks(np.arange(len(PROTOCOLS)), [p.replace("_", " ") for p in PROTOCOLS])
figure.legend(*axes[0].get_legend_handles_labels(), ncols=4, loc="outside upper center")
figure.savefig(OUT / "errors.png", dpi=150)
print(f"\nTables and the figure, medians and quartiles, are in {OUT}/")
