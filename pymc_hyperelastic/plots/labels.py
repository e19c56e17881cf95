"""Words, symbols and units by which figures name quantities: the only table of them in plots."""

# Name of a quantity: words of its axis, and the unit of its numbers; None if it has none.
LABELS: dict[str, tuple[str, str | None]] = {
    "radius": ("internal radius $a$", "mm"),
    "outer_diameter": ("outer diameter $d_o$", "mm"),
    "axial_stretch": (r"axial stretch $\lambda_z$", None),
    "inner_radius": ("unloaded internal radius $A$", "mm"),
    "outer_radius": ("unloaded outer radius $B$", "mm"),
    "thickness": ("unloaded thickness $B-A$", "mm"),
    "position": ("place in the wall $(R-A)/(B-A)$", None),
    "pressure": ("pressure", "kPa"),
    "stiffness": ("stiffness d$p$/d$a$", "kPa/mm"),
    "axial_force": ("reduced axial force", "mN"),
    "stress": ("Cauchy stress", "kPa"),
    "sigma_rr": ("radial stress", "kPa"),
    "sigma_tt": ("hoop stress", "kPa"),
    "sigma_zz": ("axial stress", "kPa"),
    "compliance": ("compliance d$A$/d$p$", "mm²/kPa"),
    "distensibility": ("distensibility", "1/kPa"),
    "peterson_modulus": ("Peterson's modulus", "kPa"),
    "incremental_modulus": ("incremental modulus", "kPa"),
    "pulse_wave_velocity": ("pulse wave velocity", "m/s"),
    "circumferential_stress": ("mean circumferential\nCauchy stress", "kPa"),
    "axial_stress": ("mean axial\nCauchy stress", "kPa"),
    "circumferential_material_stiffness": ("circumferential material\nstiffness", "kPa"),
    "axial_material_stiffness": ("axial material\nstiffness", "kPa"),
    "stored_energy": ("stored energy", "kJ/m³"),
    # Parameters whose symbols no strain energy states.
    "sigma": (r"$\sigma$", None),
    "slope_weight": (r"$\beta$", None),
    # Measures by which laws, groups and planned tests are compared.
    "probability": ("probability", None),
    "log_evidence": ("log evidence less the largest", "nats"),
    "effect_size": ("difference of typical specimens\n(spreads between specimens)", None),
    "best_accuracy": ("right answers, at best,\nabout a single specimen", None),
    "information": ("expected information", "nats"),
    "difference": ("less than the first", "nats"),
    # Labels by which curves differ.
    "group": ("group", None),
    "class_label": ("class", None),
    "specimen": ("specimen", None),
    "experiment": ("experiment", None),
}


def axis_label(name: str, pressure_unit: str = "kPa") -> str:
    """Label of an axis: a quantity and its unit, in which this unit of pressure replaces kPa.

    Examples
    --------
    >>> axis_label("stiffness", "mmHg")
    'stiffness d$p$/d$a$ (mmHg/mm)'
    """
    words, unit = LABELS.get(name, (name, None))
    return f"{words} ({unit.replace('kPa', pressure_unit)})" if unit else words


def words(name: str) -> str:
    """Words of a quantity or a label, without symbol and unit.

    Examples
    --------
    >>> words("axial_stretch"), words("specimen")
    ('axial stretch', 'specimen')
    """
    return LABELS[name][0].split(" $")[0]
