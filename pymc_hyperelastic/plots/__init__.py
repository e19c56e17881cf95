"""The figures of a study, in the manner of arviz-plots: each returns a PlotCollection.

Neither matplotlib nor arviz_plots is imported until the first figure is drawn.
"""

from pymc_hyperelastic.plots.calibration import plot_calibration_ranks, plot_reliability
from pymc_hyperelastic.plots.density import plot_parameter_density
from pymc_hyperelastic.plots.fit import plot_pressure_fit
from pymc_hyperelastic.plots.inflation import plot_inflation
from pymc_hyperelastic.plots.probability import plot_class_probability

__all__ = [
    "plot_calibration_ranks",
    "plot_class_probability",
    "plot_inflation",
    "plot_parameter_density",
    "plot_pressure_fit",
    "plot_reliability",
]
