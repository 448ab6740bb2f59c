"""The contract of a table, what pandas sees of it, and the hash of its content."""

import io

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.engine.table import Column, Table, columns_of, content_hash

TABLE = Table(
    "loads",
    "sample, pin",
    (
        Column("sample", "int32", "1", "number of the sample"),
        Column("force_N", "float64", "N", "contact force"),
        Column("active", "bool", "", "in contact"),
        Column("kind", "label", "", "pin or roller"),
    ),
)


def rows(n: int) -> dict[str, object]:
    return {
        "kind": np.array(["pin", "roller"], dtype=object)[np.arange(n) % 2],
        "sample": np.arange(n) // 3,
        "force_N": np.linspace(-1, 1, n),
        "active": np.arange(n) % 3 == 0,
    }


def test_a_column_of_a_kind_that_tables_have_not_is_refused() -> None:
    with pytest.raises(ValueError, match="column cycles: 'int64'; must be one of int32, float64, bool, label"):
        Column("cycles", "int64", "1", "load cycles")


def test_pandas_reads_types_labels_and_metadata() -> None:
    data = TABLE.part(rows(7)).data
    frame = pd.read_parquet(io.BytesIO(data))
    assert [str(t) for t in frame.dtypes] == ["int32", "float64", "bool", "category"]
    assert list(frame.columns) == ["sample", "force_N", "active", "kind"]  # the order of the contract, not of the body
    assert list(frame["kind"]) == ["pin", "roller"] * 3 + ["pin"]
    schema = pq.read_schema(io.BytesIO(data))
    assert schema.field("force_N").metadata == {b"unit": b"N", b"meaning": b"contact force"}
    assert schema.metadata[b"row_per"] == b"sample, pin"


def test_values_survive_the_round_trip() -> None:
    columns = rows(7) | {"force_N": np.array([0.1, np.nan, np.inf, -0.0, 1e-300, 5, 6])}
    columns["kind"] = pd.Categorical.from_codes([0, 1, -1, 0, 0, 1, 1], ["pin", "roller"])
    table = pq.read_table(io.BytesIO(TABLE.part(columns).data))
    assert table["force_N"].null_count == 1  # a missing value is null on disk, not NaN
    return_value = columns_of(table)
    np.testing.assert_array_equal(return_value["force_N"], columns["force_N"])
    assert return_value["kind"].tolist()[:3] == ["pin", "roller", np.nan]
    assert all(array.flags.writeable for name, array in return_value.items() if name != "kind")


def test_labels_of_parts_with_different_categories_are_joined(tmp_path) -> None:
    for number, label in enumerate(["pin", "roller"]):
        part = TABLE.part({"sample": [number], "force_N": [0.0], "active": [True], "kind": [label]})
        (tmp_path / f"part-{number}.parquet").write_bytes(part.data)
    assert list(pd.read_parquet(tmp_path)["kind"]) == ["pin", "roller"]
    assert list(columns_of(pq.read_table(tmp_path))["kind"]) == ["pin", "roller"]


def test_the_ends_of_32_bits_fit() -> None:
    ends = [-(2**31), 0, 2**31 - 1]
    assert TABLE.to_arrow(rows(3) | {"sample": ends})["sample"].to_pylist() == ends


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force_N": None}, "no column force_N"),
        ({"forces": [1, 2, 3]}, "unknown column forces"),
        ({"sample": [0.0, 1.0, 2.0]}, "column sample: is float64, must be int32"),
        ({"sample": [0, 1, 2**31]}, "column sample: does not fit 32 bits"),
        ({"sample": [-(2**31) - 1, 0, 1]}, "column sample: does not fit 32 bits"),
        ({"active": [0, 1, 0]}, "column active: is int64, must be bool"),
        ({"force_N": ["a", "b", "c"]}, "column force_N: is <U1, must be float64"),
        ({"force_N": np.zeros((3, 1))}, r"column force_N: has shape \(3, 1\), must have one axis"),
        ({"kind": [1, 2, 3]}, "column kind: "),
        ({"kind": ["pin"]}, "different lengths .*'kind': 1"),
    ],
)
def test_a_wrong_column_is_named(change: dict, message: str) -> None:
    columns = {name: values for name, values in (rows(3) | change).items() if values is not None}
    with pytest.raises(TypeError, match=f"table loads: .*{message}"):
        TABLE.to_arrow(columns)


def test_all_wrong_columns_are_named_at_once() -> None:
    with pytest.raises(TypeError, match="no column active; unknown column x; column sample: is bool"):
        TABLE.to_arrow({"sample": [True], "force_N": [1], "kind": ["pin"], "x": [1]})


def test_empty_table_has_its_columns() -> None:
    frame = pd.read_parquet(io.BytesIO(TABLE.part(TABLE.empty()).data))
    assert list(frame.columns) == TABLE.schema.names
    assert len(frame) == 0
    assert str(frame["kind"].dtype) == "category"


def digest(*columns: dict[str, object]) -> str:
    return content_hash(TABLE, (TABLE.part(part).content for part in columns))


def cut(columns: dict, reducer: list[int]) -> list[dict]:
    ends = [0, *sorted(reducer), len(columns["sample"])]
    return [{name: values[a:b] for name, values in columns.items()} for a, b in zip(ends[:-1], ends[1:], strict=True)]


@given(items=st.lists(st.integers(0, 9), max_size=4), order=st.randoms(use_true_random=False))
@pytest.mark.long
def test_content_hash_is_of_values_not_of_parts(items: list[int], order) -> None:
    parts = cut(rows(30), [3 * item for item in items])
    order.shuffle(parts)
    assert digest(*parts) == digest(rows(30))


@pytest.mark.parametrize("name", ["sample", "force_N", "active", "kind"])
def test_content_hash_sees_a_change_of_one_value(name: str) -> None:
    variant = rows(9) | {name: rows(9)[name].copy()}
    last_value = 5  # row of an item
    variant[name][last_value] = {"sample": 2, "force_N": np.nextafter(0.25, 1), "active": True, "kind": "roller "}[name]
    assert digest(variant) != digest(rows(9))


def test_content_hash_sees_the_last_byte_of_an_item() -> None:
    flags = Table("flags", "sample", (TABLE.columns[0], TABLE.columns[2]))
    parts = [
        flags.part({"sample": [0, 0, 1], "active": [True, last_value, True]}).content for last_value in (False, True)
    ]
    assert parts[0] != parts[1]


def test_content_hash_sees_the_order_of_rows_of_an_item_and_an_exchange_between_columns_of_items() -> None:
    swapped = {name: values[[1, 0, 2]] for name, values in rows(3).items()}
    assert digest(swapped) != digest(rows(3))
    exchanged = rows(6)
    exchanged["force_N"] = exchanged["force_N"][[3, 4, 5, 0, 1, 2]]
    assert digest(exchanged) != digest(rows(6))


def test_content_hash_is_blind_to_the_coding_of_labels_and_the_sign_of_nan() -> None:
    kinds = rows(4)["kind"]
    recoded = rows(4) | {"kind": pd.Categorical(kinds, categories=["unused", "roller", "pin"])}
    assert digest(recoded) == digest(rows(4))
    plus, minus = (rows(4) | {"force_N": np.copysign(np.full(4, np.nan), sign)} for sign in (1, -1))
    assert digest(plus) == digest(minus)


@pytest.mark.parametrize("item", ["sample", "unit"])
def test_the_hash_of_a_table_does_not_depend_on_its_chunks(item: str) -> None:
    """That of the drivers' units did: their item is no sample, and each chunk counted as one."""
    columns = (Column(item, "int32", "1", "number"), Column("force_N", "float64", "N", "contact force"))
    table = Table("units", item, columns, item=item)
    whole = {item: np.arange(12), "force_N": np.linspace(-1, 1, 12)}
    parts = [table.part({name: values[a:b] for name, values in whole.items()}) for a, b in ((0, 5), (5, 12))]
    assert content_hash(table, [part.content for part in parts]) == content_hash(table, [table.part(whole).content])
