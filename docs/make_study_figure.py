"""Make ``_static/study.png``, the figure of the README, from a study on SIMULATED aortas.

Run it as ``python docs/make_study_figure.py``; it takes less than a minute.
"""

from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

import pymc_hyperelastic as ph

PATH = Path(__file__).parent / "_static" / "study.png"
WIDTH, DPI = 5.35, 150  # of each of the four pictures, in inches and dots per inch


def picture(plot, data, height, **settings):
    """Draw one figure of the study as an array of pixels."""
    figure = plot(data, figure_kwargs={"figsize": (WIDTH, height)}, **settings)
    file = BytesIO()
    figure.get_viz("figure").savefig(file, dpi=DPI)
    return np.asarray(Image.open(file).convert("RGB"))


data = ph.load_dataset("simulated_sheep_aorta")
classes = ph.fit_classes(
    ph.Ogden(),
    {name: ph.select(data, group=name, experiment=[1, 2]) for name in ("C1", "C2")},
    ph.SlopeAugmented(
        sigma=15 * ph.mmHg,
        slope_weight=ph.balanced_slope_weight(ph.select(data, experiment=[1, 2])),
    ),
    draws=1000,
    chains=2,
    random_seed=1,
    progressbar=False,
)
result = ph.classify(ph.select(data, experiment=3), classes, random_seed=2, progressbar=False)

columns = [
    [
        picture(ph.plot_inflation, data, 3.3, pressure_unit="mmHg"),
        picture(ph.plot_fit, classes, 5.4, specimens=["S2", "S4"], pressure_unit="mmHg"),
    ],
    [
        picture(ph.plot_parameter_density, classes, 5.2),
        picture(ph.plot_class_probability, result, 3.5),
    ],
]
pixels = np.concatenate([np.concatenate(column) for column in columns], axis=1)
# Few colours make a small file.
Image.fromarray(pixels).quantize(128).save(PATH, optimize=True)
