"""The contract of the tables for users of pandas: columns, types, keys and rows."""

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from contract import CONTRACT, path_of

INTEGERS = {
    "sample", "pin", "lobe", "disk", "interface", "roller", "contact", "face", "end", "station", "row", "step",
    "pins_in_contact", "outputs_in_contact", "iterations", "n", "n_angles", "n_rigid_angles", "n_searched", "n_solved",
}  # fmt: skip
LABELS = {
    "kind", "body_a", "body_b", "label", "law", "branch", "status", "metric", "statistic", "parameter", "over",
}  # fmt: skip
TRUTHS = {"preloaded", "beyond_limit", "extrapolated", "solved"}
UNITS = {"um": "um", "mm": "mm", "Nm": "N m", "N": "N", "MPa": "MPa", "arcmin": "arcmin", "deg": "deg", "rad": "rad"}


@pytest.mark.parametrize("table", CONTRACT)
def test_columns_types_and_units_are_those_of_the_contract(outputs, runs, table):
    path = path_of(runs, table)
    schema = pq.read_schema(next(iter(sorted(path.glob("part-*.parquet"))), path))
    key, type_name = (names.split() for names in CONTRACT[table])
    assert set(key + type_name) <= set(schema.names)
    assert schema.metadata[b"row_per"]
    for name in schema.names:
        expected = (
            pa.int32() if name in INTEGERS
            else pa.dictionary(pa.int32(), pa.string()) if name in LABELS
            else pa.bool_() if name in TRUTHS or name.endswith("_valid")
            else pa.float64()
        )  # fmt: skip
        assert schema.field(name).type == expected, name
        unit = schema.field(name).metadata[b"unit"].decode()
        named_effects = UNITS.get(name.rsplit("_", 1)[-1])
        if named_effects and "_per_" not in name:
            assert unit == named_effects, name


@pytest.mark.parametrize("table", CONTRACT)
def test_keys_are_unique_and_sorted_by_sample(frames, table):
    key, frame = CONTRACT[table][0].split(), frames[table]
    assert len(frame) > 0
    assert not frame.duplicated(key).any()
    if "sample" in frame:
        assert frame["sample"].is_monotonic_increasing
        assert sorted(frame["sample"].unique()) == list(range(9))  # the nominal reducer and 8 samples


def test_every_table_holds_every_combination_of_its_key(frames):
    samples, cranks, contacts, steps = 9, 2, 120, 68
    for table, rows in {
        "sample/pins": samples * 80,
        "sample/lobes": samples * 79,
        "sample/rollers": samples * 40,
        "clearance/contacts": cranks * contacts,
        "clearance/gaps": samples * cranks * contacts,
        "clearance/kinematic": samples * 32,  # 31 of the turn and the one loaded angle that is not among them
        "hysteresis/loops": samples * cranks,
        "aggregate/units": samples,
        "springs/laws": cranks * (contacts + 1) * 200,
        "reduce/contacts": cranks * 100,
        "hysteresis/curves": samples * cranks * steps,
        "hysteresis/contacts": samples * cranks * steps * contacts,
        "hysteresis/status": samples * cranks,
        "aggregate/metrics": samples * cranks,
    }.items():
        assert len(frames[table]) == rows, table
