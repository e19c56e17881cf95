"""Bayesian models of hyperelastic tubes and sheets.

Curves of inflated tubes and of stretched sheets go in; probability distributions of material
parameters, class evidences and class probabilities come out, as ordinary PyMC models and ArviZ
results.
"""

from importlib.metadata import version

from pymc_hyperelastic.classes.classify import classify
from pymc_hyperelastic.classes.compare_classes import compare_classes
from pymc_hyperelastic.classes.cross_validate import cross_validate
from pymc_hyperelastic.classes.divergence import kl_divergence
from pymc_hyperelastic.classes.explain import explain_classification
from pymc_hyperelastic.classes.fit import fit_classes
from pymc_hyperelastic.classes.scores import score_probabilities
from pymc_hyperelastic.cohort import fit_cohort
from pymc_hyperelastic.data.datasets import list_datasets, load_dataset
from pymc_hyperelastic.data.files import read_tests
from pymc_hyperelastic.data.select import select
from pymc_hyperelastic.data.sheet_table import sheet_data
from pymc_hyperelastic.data.sheets import combine_tests
from pymc_hyperelastic.data.table import inflation_data
from pymc_hyperelastic.data.units import mmHg
from pymc_hyperelastic.design.information import expected_information
from pymc_hyperelastic.design.study_size import plan_study
from pymc_hyperelastic.evidence.bridge import bridge_sampling
from pymc_hyperelastic.evidence.calibration import simulation_based_calibration
from pymc_hyperelastic.evidence.diagnosis import diagnose_evidence, log_evidence
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.quadrature import log_evidence_by_quadrature
from pymc_hyperelastic.evidence.smc import sample_smc
from pymc_hyperelastic.io.open import open_result
from pymc_hyperelastic.io.results import save_result
from pymc_hyperelastic.io.store import Store
from pymc_hyperelastic.mechanics import strain_energy
from pymc_hyperelastic.mechanics.curves import axial_force, inflation_pressure, inflation_stiffness
from pymc_hyperelastic.mechanics.integrals import PressureIntegral
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.reference_tube import Tube
from pymc_hyperelastic.mechanics.sheet import free_stretch, sheet_stress
from pymc_hyperelastic.mechanics.strain_energy import *  # noqa: F403
from pymc_hyperelastic.models.geometry import MeasuredValue
from pymc_hyperelastic.models.inflation import (
    criscione_model,
    inflation_model,
    material_model,
    ogden_model,
    power_law_neo_hookean_model,
)
from pymc_hyperelastic.models.likelihoods import (
    Gaussian,
    SlopeAugmented,
    balanced_slope_weight,
    inflation_likelihood,
)
from pymc_hyperelastic.models.population import population_model
from pymc_hyperelastic.models.variability import Variability
from pymc_hyperelastic.plots.calibration import plot_calibration_ranks, plot_reliability
from pymc_hyperelastic.plots.comparison import plot_comparison
from pymc_hyperelastic.plots.density import plot_parameter_density
from pymc_hyperelastic.plots.fit import plot_fit
from pymc_hyperelastic.plots.inflation import plot_inflation
from pymc_hyperelastic.plots.information import plot_information
from pymc_hyperelastic.plots.laws import plot_law_probability
from pymc_hyperelastic.plots.probability import plot_class_probability
from pymc_hyperelastic.plots.properties import plot_elastic_properties, plot_wall_stress
from pymc_hyperelastic.plots.sheet_tests import plot_sheet_tests
from pymc_hyperelastic.plots.specimens import plot_specimens
from pymc_hyperelastic.predictions.admissible import is_admissible
from pymc_hyperelastic.predictions.cards import material_card
from pymc_hyperelastic.predictions.conditions import Conditions
from pymc_hyperelastic.predictions.curves import (
    predict_axial_force,
    predict_pressure,
    radius_at_pressure,
)
from pymc_hyperelastic.predictions.offsets import force_offsets
from pymc_hyperelastic.predictions.properties import tube_properties
from pymc_hyperelastic.predictions.sheets import predict_stress
from pymc_hyperelastic.predictions.stress import wall_stress
from pymc_hyperelastic.reports.report import report

__version__ = version("pymc-hyperelastic")

# In the order in which a study uses them.
__all__ = [
    "load_dataset",
    "list_datasets",
    "inflation_data",
    "sheet_data",
    "read_tests",
    "combine_tests",
    "select",
    "mmHg",
    *strain_energy.__all__,
    "Tube",
    "Layer",
    "MeasuredValue",
    "PressureIntegral",
    "inflation_pressure",
    "inflation_stiffness",
    "axial_force",
    "sheet_stress",
    "free_stretch",
    "Gaussian",
    "SlopeAugmented",
    "balanced_slope_weight",
    "inflation_likelihood",
    "inflation_model",
    "material_model",
    "power_law_neo_hookean_model",
    "ogden_model",
    "criscione_model",
    "Variability",
    "population_model",
    "sample_smc",
    "BatchedSMC",
    "log_evidence",
    "diagnose_evidence",
    "bridge_sampling",
    "log_evidence_by_quadrature",
    "Estimate",
    "Conditions",
    "predict_pressure",
    "predict_axial_force",
    "radius_at_pressure",
    "force_offsets",
    "tube_properties",
    "wall_stress",
    "predict_stress",
    "is_admissible",
    "material_card",
    "fit_classes",
    "classify",
    "explain_classification",
    "compare_classes",
    "expected_information",
    "plan_study",
    "kl_divergence",
    "cross_validate",
    "simulation_based_calibration",
    "score_probabilities",
    "fit_cohort",
    "Store",
    "save_result",
    "open_result",
    "plot_inflation",
    "plot_sheet_tests",
    "plot_parameter_density",
    "plot_fit",
    "plot_elastic_properties",
    "plot_wall_stress",
    "plot_class_probability",
    "plot_law_probability",
    "plot_comparison",
    "plot_specimens",
    "plot_information",
    "plot_calibration_ranks",
    "plot_reliability",
    "report",
]
