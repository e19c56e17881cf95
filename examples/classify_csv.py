"""
Classify the curves of a CSV file
=================================

From the table of a laboratory to a report in three steps: read the table, fit a class to each
group, and classify new specimens. Save the file :download:`curves.csv` beside this script. It holds
the **simulated** sheep aortas; replace it with your own file. The names of its columns contain the
units. A column ``split`` states which rows are training data and which are new. In this example the
new rows are further experiments on the training specimens, which causes a warning.

The command ``pymc-hyperelastic`` does the same without Python, and has more options::

    pymc-hyperelastic check curves.csv
    pymc-hyperelastic fit curves.csv
    pymc-hyperelastic classify curves.csv
    pymc-hyperelastic report
"""

import pymc as pm

import pymc_hyperelastic as ph

FILE = "curves.csv"

# %%
# Read the table, and print how each column was read. An error message would list the problems row
# by row.
data = ph.read_tests(FILE)
print(data.attrs["understood"])
known, new = ph.select(data, split="train"), ph.select(data, split="new")

# %%
# Fit a class with variability to each group. The size of the errors is inferred.
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
# The figure shows the class probabilities (bars), the p-values (diamonds) and their limit. If all
# p-values are below the limit, the decision is "none of these".
figure = ph.plot_class_probability(result, none_below=0.05)

# %%
# Write a report: warnings first, then data, fits, decisions, and a paragraph on the methods.
ph.report({"Classes": classes, "New specimens": result}, "report.html", new)
