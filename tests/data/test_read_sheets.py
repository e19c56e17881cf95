"""read_tests reads tables of sheets, or refuses them with what to do."""

from importlib.resources import as_file, files

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from tables import good_frame
from written import message_of

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.datasets import load_dataset
from pymc_hyperelastic.data.inflation import check_data
from pymc_hyperelastic.data.sheets import sheet_tests
from pymc_hyperelastic.data.units import mmHg
from pymc_hyperelastic.quantities import SHEET_VARIABLES

ROUNDING = 1e-12  # conversions of units and measures
LABELS = "specimen,experiment"
X, STRESS = np.array([1.0, 1.1, 1.2]), np.array([0.0, 10.0, 30.0])


def lines(*columns: object) -> str:
    """Rows of a test A, 1 with these columns."""
    columns = [np.broadcast_to(np.asarray(column, dtype=object), 3) for column in columns]
    return "".join(f"A,1,{','.join(map(str, row))}\n" for row in zip(*columns, strict=True))


def values(data: xr.Dataset) -> np.ndarray:
    return np.array([data[name].values for name in SHEET_VARIABLES])


UNIAXIAL = ph.sheet_data(
    pd.DataFrame({"specimen": "A", "experiment": 1, "stretch": X, "stress": STRESS}),
    stress="nominal",
    kind="uniaxial",
)
# Names of the columns, the columns, and settings: the same uniaxial test with nominal stresses.
SAME = {
    "two axes": (
        "stretch x,stretch y,nominal stress x [kPa],nominal stress y [kPa]",
        (X, "", STRESS, ""), {},
    ),
    "Greek letters, MPa": (
        "λx,λy,σx (MPa),σy (MPa)", (X, "-", STRESS / 1e3, "n/a"),
        {"constants": {"stress_measure": "nominal"}},
    ),
    "a column of kinds": (
        "lambda_x,1st PK stress x (N/mm²),kind", (X, STRESS / 1e3, "uniaxial"), {},
    ),
    "no axis": (
        "stretch,engineering stress / Pa,kind of test", (X, STRESS * 1e3, "Uniaxial x"), {},
    ),
    "per cent": (
        "strain [%],nominal_stress_kPa", (100 * (X - 1), STRESS),
        {"constants": {"kind": "uniaxial"}, "columns": {"engineering_strain": "strain"}},
    ),
    "Green strain": (
        "Green strain x,nominal stress x,stress_measure", ((X**2 - 1) / 2, STRESS, "nominal"),
        {"constants": {"kind": "uniaxial"}, "stress_unit": "kPa"},
    ),
    "force and displacement": (
        "Extension (mm),Load (N)", (20 * (X - 1), 4 * STRESS / 1e3),
        {"constants": {"kind": "uniaxial", "gauge_length_mm": 20, "area_mm2": 4}},
    ),
    "other names": (
        "Dehnung,Spannung [kPa]", (X, STRESS),
        {"columns": {"stretch": "Dehnung", "nominal_stress": "Spannung"},
         "constants": {"kind": "uniaxial"}},
    ),
}  # fmt: skip


@pytest.mark.parametrize("names, columns, settings", SAME.values(), ids=SAME)
def test_tables_of_sheets_are_read_by_the_names_of_their_columns(names, columns, settings, written):
    data = written(f"{LABELS},{names}\n{lines(*columns)}", settings=settings)
    np.testing.assert_allclose(values(data), values(UNIAXIAL), rtol=ROUNDING, atol=ROUNDING)
    assert data["stress_measure"].values.tolist() == ["nominal"]
    assert data["row"].values.tolist() == [f"a.csv, line {i}" for i in (2, 3, 4)]
    assert "together: 1 specimen, 1 experiment, 3 points" in data.attrs["understood"]
    check_data(data)


FIBRES = {
    "stretch_x": "stretch fibre",
    "stretch_y": "stretch cross fibre",
    "nominal_stress_x": "nominal stress fibre",
    "nominal_stress_y": "nominal stress cross fibre",
}


@pytest.mark.parametrize(
    "name, settings", [("porcine_skin", None), ("human_myocardium", {"columns": FIBRES})]
)
def test_shipped_tables_are_read_as_their_datasets(name, settings):
    with as_file(files("pymc_hyperelastic.data.datasets") / f"{name}.csv") as path:
        data, expected = ph.read_tests(path, settings), load_dataset(name)
    np.testing.assert_allclose(values(data), values(expected), rtol=ROUNDING)
    for label in ("specimen", "experiment", "stress_measure"):
        assert data[label].values.tolist() == expected[label].values.tolist()


def test_report_of_the_reader_names_columns_units_and_empty_columns(written):
    names, columns, settings = SAME["Greek letters, MPa"]
    data = written(f"{LABELS},{names}\n{lines(*columns)}", settings=settings)
    assert data.attrs["understood"].splitlines() == [
        "a.csv: UTF-8, separated by commas, decimal points, 3 rows",
        "  'specimen' is specimen: 1 label",
        "  'experiment' is experiment: 1 label",
        "  'λx' is stretch_x: 1 to 1.2",
        "  'λy' is stretch_y, without any entry",
        "  'σx (MPa)' is stress_x in MPa (1 MPa is 1000 kPa): 0 to 0.03",
        "  'σy (MPa)' is stress_y, without any entry",
        "the same in all rows of all files: stress_measure 'nominal'",
        "together: 1 specimen, 1 experiment, 3 points",
    ]


def test_measures_of_specimens_come_from_their_table(written):
    points = f"{LABELS},displacement [mm],force [N]\n{lines(20 * (X - 1), 4 * STRESS / 1e3)}"
    specimens = (
        "id,gauge length (cm),area [mm2],kind,group,thickness,animal\nA,2,4,uniaxial,old,?,M\n"
    )
    data = written(points, specimens)
    np.testing.assert_allclose(values(data), values(UNIAXIAL), rtol=ROUNDING, atol=ROUNDING)
    assert data["group"].item() == "old" and data["animal"].item() == "M"
    assert "not used: 'thickness'" in data.attrs["understood"]


def test_tubes_and_sheets_of_one_study_are_read_together(written):
    tubes = good_frame().assign(pressure=lambda f: f["pressure"] / mmHg)
    tubes = tubes.drop(columns=["stretch", "angle"])
    table = tubes.rename(columns={"pressure": "p (mmHg)", "radius": "r [mm]"}).to_csv(index=False)
    table = table.replace(",A,B", ",inner_radius_mm,outer_radius_mm")
    sheets = "group,specimen,experiment,stretch,Cauchy stress [kPa],kind\n"
    sheets += "".join(f"C1,S1,strip,{x},{s},uniaxial\n" for x, s in zip(X, X * STRESS, strict=True))
    sheets += "C3,S9,biaxial,1.2,1,equibiaxial\nC3,S9,biaxial,1.3,2,equibiaxial\n"
    other = f"{LABELS},stretch x,stretch y,nominal stress x [kPa],nominal stress y [kPa],group\n"
    other += "S8,1,1.1,1,2,1,C1\nS8,1,1.2,1,5,3,C1\n"
    data = written(table, sheets, other)
    assert sheet_tests(data).tolist() == [False] * 3 + [True] * 3
    assert data["stress_measure"].values[3:].tolist() == ["cauchy", "cauchy", "nominal"]
    assert dict(data.sizes) == {"obs": 13, "test": 6}
    check_data(data)
    alone = written(sheets)
    own = ph.select(data, None, ["strip", "biaxial"])
    xr.testing.assert_equal(own.drop_vars("row"), alone.drop_vars("row"))
    assert "together: 2 specimens, 3 experiments, 6 points" in data.attrs["understood"]
    assert "together: 3 specimens, 3 experiments, 7 points" in data.attrs["understood"]
    message = message_of(written, table, sheets.replace("strip", "1"))
    assert message == (
        "a.csv, line 2 and b.csv, line 4: specimen 'S1', experiment 1 is a test of a tube and of "
        "a sheet: give the two different labels of the experiment"
    )


def test_columns_of_sheets_in_a_table_of_tubes_are_not_used(written):
    head = "specimen,experiment,radius_mm,pressure_kPa,stress,force,kind,displacement,stretch"
    data = written(f"{head}\nS1,1,7.2,1.0,?,x,y,z,1.2\nS1,1,8.4,6.5,?,x,y,z,1.2\n")
    assert "not used: 'stress', 'force', 'kind', 'displacement'" in data.attrs["understood"]
    assert data["axial_stretch"].item() == 1.2


def test_last_cycles_of_sheets_are_taken(written):
    head = "specimen,test,cycle,phase,stretch,nominal stress [kPa],kind\n"
    rows = [
        f"A,1,{cycle},{phase},{x},{s + cycle},uniaxial\n"
        for cycle in (1, 2)
        for phase in ("loading", "unloading")
        for x, s in [*zip(X, STRESS, strict=True)][:: 1 if phase == "loading" else -1]
    ]
    data = written(head + "".join(rows))
    assert data["cycle"].values.tolist() == [2, 2]
    assert "of these the last cycle of each, 6 points, is taken" in data.attrs["understood"]
    data = written(head + "".join(rows), settings={"cycles": "all"})
    assert data["cycle"].values.tolist() == [1, 1, 2, 2]


# Tables, settings, and the message of the ValueError.
ALL = "stretch_x or engineering_strain_x or green_strain_x or displacement_x"
REFUSED = {
    "measure": (
        [f"{LABELS},stretch,stress [kPa]\n{lines(X, STRESS)}"], {"constants": {"kind": "uniaxial"}},
        "a.csv: 'stress [kPa]' may be a Cauchy stress, force over the deformed cross-section "
        "(cauchy), or over the unloaded one (nominal): say which in the settings, "
        'constants.stress_measure = "cauchy" or "nominal", or in the name of the column, as in '
        "Cauchy stress",
    ),
    "unknown measure": (
        [f"{LABELS},stretch,stress [kPa]\n{lines(X, STRESS)}"],
        {"constants": {"stress_measure": "true"}, "files": {"a.csv": {"kind": "uniaxial"}}},
        "3 problems:\n" + "\n".join(
            f"- a.csv, line {i}: stress_measure is 'true'; expected one of ('cauchy', 'nominal')"
            for i in (2, 3, 4)
        ),
    ),
    "other measure": (
        [f"{LABELS},stretch,true stress [kPa]\n{lines(X, STRESS)}"],
        {"constants": {"stress_measure": "nominal"}},
        "a.csv: 'true stress [kPa]' is cauchy stress, and stress_measure is 'nominal': correct "
        "one of them",
    ),
    "strain": (
        [f"{LABELS},strain x,nominal stress x [kPa]\n{lines(X - 1, STRESS)}"], {},
        "a.csv, line 1: 'strain x' may be engineering_strain_x or green_strain_x: say which in the "
        "settings, columns.engineering_strain_x = 'strain x' or columns.green_strain_x = 'strain "
        "x'",
    ),
    "no stretch, no unit": (
        [f"{LABELS},force x,load\n{lines(X, STRESS)}"], {},
        "3 problems:\n"
        "- a.csv, line 1: 'force x' has no unit: write it into the name, such as 'force x [mN]', "
        "or say force_unit in the settings\n"
        "- a.csv, line 1: 'load' has no unit: write it into the name, such as 'load [mN]', or say "
        "force_unit in the settings\n"
        f"- a.csv has 'specimen', 'experiment', 'force x', 'load', and no column {ALL}: rename it, "
        "or give its name in the settings, columns.stretch_x (stretch_x may be called lambda x, "
        "lambdax, λx, λ x)",
    ),
    "length without a unit": (
        [f"{LABELS},displacement,nominal stress [kPa]\n{lines(X, STRESS)}"], {},
        "a.csv, line 1: 'displacement' has no unit: write it into the name, such as 'displacement "
        "[mm]', or say units.displacement in the settings",
    ),
    "no gauge length": (
        [f"{LABELS},displacement [mm],nominal stress [kPa]\n{lines(X, STRESS)}"], {},
        "a.csv, line 2: there is a displacement, and no gauge length: give the tables a column "
        "gauge_length, or gauge_length_x and gauge_length_y, or the settings "
        "constants.gauge_length",
    ),
    "two of a kind": (
        [f"{LABELS},stretch x,Green strain x,nominal stress x [kPa],force x [N]\n"
         f"{lines(X, X - 1, STRESS, 1)}"], {},
        "2 problems:\n"
        "- a.csv has 'stretch x' and 'Green strain x', which state the same: keep one of them, and "
        "name the others in the list ignore of the settings\n"
        "- a.csv has 'nominal stress x [kPa]' and 'force x [N]', which state the same: keep one of "
        "them, and name the others in the list ignore of the settings",
    ),
    "no kind": (
        [f"{LABELS},stretch,nominal stress [kPa]\n{lines(X, STRESS)}"], {},
        "a.csv: 'stretch' states no axis: say the kind, uniaxial, equibiaxial or pure_shear, in a "
        "column or in constants.kind; or of biaxial tests give 'stretch_x' and 'stretch_y'",
    ),
    "constant and column": (
        [f"{LABELS},stretch,nominal stress [kPa],kind\n{lines(X, STRESS, 'uniaxial')}"],
        {"constants": {"kind": "uniaxial"}},
        "kind is 'uniaxial' in the settings, and a.csv has a column of it, 'kind': remove one, or "
        "name the column in the list ignore",
    ),
    "not a number": (
        [f"{LABELS},stretch,nominal stress [kPa],kind\n{lines(X, 'x', 'uniaxial')}"], {},
        "a.csv, lines 2 to 4: 'nominal stress [kPa]' is 'x', not a number: correct it, or delete "
        "the line",
    ),
    "missing": (
        [f"{LABELS},stretch,nominal stress [kPa],kind\n{lines(X, ['', 1, 2], 'uniaxial')}"], {},
        "specimen 'A', experiment 1, a.csv, line 2: stress is missing (nan); fill it or drop the "
        "row",
    ),
    "strain as stretch": (
        [f"{LABELS},stretch,nominal stress [kPa],kind\n{lines(X - 1, STRESS, 'uniaxial')}"], {},
        "specimen 'A', experiment 1, a.csv, line 2: stretch is 0; expected a positive ratio of "
        "lengths, 1 for an unstretched sheet: was a strain given? Then name the column "
        "engineering_strain (λ − 1) or green_strain ((λ² − 1)/2)",
    ),
    "across": (
        [f"{LABELS},stretch x,stretch y,nominal stress x [kPa],kind\n"
         f"{lines(X, X, STRESS, 'pure shear')}"], {},
        "specimen 'A', experiment 1, a.csv, line 3: the stretch along y is 1.1; expected 1 in a "
        "test of the kind pure_shear: if it differs say kind = 'biaxial' in its column",
    ),
    "copied": (
        [f"{LABELS},stretch,nominal stress [kPa],kind\n{lines(X, STRESS, 'uniaxial')}"
         + lines(X, STRESS, "uniaxial").replace("A,", "B,")], {},
        "specimen 'A', experiment 1 (a.csv, line 2) and specimen 'B', experiment 1 (a.csv, line "
        "5) have the same 3 points, as if one had been copied: remove one, or correct it; if it "
        'is right, say check="ignore"',
    ),
    "not in the table of specimens": (
        [f"{LABELS},stretch,nominal stress [kPa],kind\n{lines(X, STRESS, 'uniaxial')}",
         "specimen,group\nB,old\n"], {},
        "a.csv, line 2: specimen 'A' has no row in the table of specimens, which has 'B': write "
        "labels in the same way, letter by letter",
    ),
    "no specimens": (
        [f"{LABELS},stretch,nominal stress [kPa],kind\n{lines(X, STRESS, 'uniaxial')}",
         "note,group\nB,old\n"], {},
        "b.csv has 'note', 'group': these are no points, with pressures, and no specimens, with a "
        "column specimen; leave the file out, or say in the settings what its columns are",
    ),
}  # fmt: skip


@pytest.mark.parametrize("tables, settings, message", REFUSED.values(), ids=REFUSED)
def test_bad_tables_of_sheets_are_refused_with_file_line_and_advice(
    tables, settings, message, written
):
    assert message_of(written, *tables, settings=settings) == message


def test_doubts_state_the_file_and_the_unit_that_was_read(written):
    table = f"{LABELS},stretch,nominal stress [Pa],kind\n{lines(X, STRESS / 10, 'uniaxial')}"
    with pytest.warns(UserWarning) as warned:
        written(table)
    assert [str(w.message) for w in warned] == [
        "a.csv: specimen 'A', experiment 1: the largest stress of a sheet is 0.003 kPa; expected "
        "at least 0.01 kPa: was another unit meant, stress_unit=... or force_unit=..., "
        "length_unit=...?; if it is right, say check=\"ignore\" ('nominal stress [Pa]' of a.csv "
        "was taken in Pa)"
    ]


NAMES = [
    "stretch x",
    "λx",
    "stretch",
    "strain [%]",
    "nominal stress x [kPa]",
    "stress",
    "force [N]",
]
CELLS = ["", "1.1", "-", "0", "-1", "x", "1,2", "inf", "1e400", "5 kPa", "uniaxial"]
SETTINGS = st.fixed_dictionaries(
    {},
    optional={
        "stress_unit": st.sampled_from(["kPa", "mm"]),
        "constants": st.dictionaries(
            st.sampled_from(["kind", "stress_measure", "gauge_length_mm", "area", "inner_radius"]),
            st.sampled_from(["uniaxial", "cauchy", 4.0, -1.0, "x"]),
        ),
        "columns": st.dictionaries(
            st.sampled_from(["stretch", "green_strain_x", "stress"]), st.sampled_from(NAMES)
        ),
    },
)


def test_randomly_changed_tables_of_sheets_give_valid_data_or_an_error_with_its_place(tmp_path):
    outcomes = set()
    path = tmp_path / "a.csv"
    names, columns, _ = SAME["two axes"]
    text = f"{LABELS},{names},kind\n{lines(*columns, 'biaxial')}"
    text += lines(*columns, "uniaxial").replace("A,1", "B,2")
    number = st.integers(0, 6)
    change = st.tuples(number, number, st.sampled_from([*NAMES, *CELLS]))

    @given(st.lists(change, max_size=2), st.one_of(st.none(), SETTINGS))
    @hypothesis_settings(
        deadline=None,
        database=None,
        derandomize=True,
        max_examples=150,
        suppress_health_check=list(HealthCheck),
    )
    def check(changes, settings):
        rows = [line.split(",") for line in text.splitlines()]
        for i, j, cell in changes:
            rows[i][j] = cell
        path.write_text("\n".join(",".join(row) for row in rows), encoding="utf-8")
        try:
            data = ph.read_tests(path, settings, check="ignore")
        except ValueError as error:
            assert "a.csv" in str(error) or "settings" in str(error), error
            outcomes.add("refused")
            return
        check_data(data)
        assert "a.csv: " in data.attrs["understood"]
        outcomes.add("read")

    check()
    assert outcomes == {"read", "refused"}
