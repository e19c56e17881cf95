"""
Classify the curves of a CSV file
=================================

From the table of a laboratory to a report in three steps: read it, fit a class to each group, and
write what new specimens are. The file that comes with this example, :download:`curves.csv`, has to
lie beside it and holds the **simulated** sheep aortas. Name your own in its place. Units stand in
the names of its columns, and a column ``split`` says which rows teach the classes and which are
new. Here the new ones are further experiments on the specimens that taught, as a warning says.

The command ``pymc-hyperelastic`` does the same without Python, and takes more options::

    pymc-hyperelastic check curves.csv
    pymc-hyperelastic fit curves.csv
    pymc-hyperelastic classify curves.csv
    pymc-hyperelastic report
"""

import pymc as pm

import pymc_hyperelastic as ph

FILE = "curves.csv"

# %%
# What was understood of the table is said; what is wrong with it would be, row by row.
data = ph.read_tests(FILE)
print(data.attrs["understood"])
known, new = ph.select(data, split="train"), ph.select(data, split="new")

# %%
# Specimens of a group differ, and how large the errors are is inferred.
groups = {name: ph.select(known, group=name) for name in sorted(set(known["group"].values))}
classes = ph.fit_classes(
    ph.Ogden(),
    groups,
    ph.Gaussian(pressure_sd=pm.HalfNormal.dist(1.0)),
    variability="specimen",
    draws=1000,
    chains=2,
    random_seed=1,
    progressbar=False,
)
result = ph.classify(new, classes, by="specimen", none_below=0.05, random_seed=1, progressbar=False)
print(result[["class_probability", "p_value", "decision"]].to_dataframe())

# %%
# The same in a figure, with the limit of the p-values (diamonds): where all are below it, a
# specimen is like none of the classes.
figure = ph.plot_class_probability(result, none_below=0.05)

# %%
# One file holds it all: warnings first, then data, fits, decisions, and a paragraph of methods.
ph.report({"Classes": classes, "New specimens": result}, "report.html", new)
