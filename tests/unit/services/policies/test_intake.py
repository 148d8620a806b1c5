import json
import struct

import numpy as np
import pytest
import safetensors.numpy
from hypothesis import given, settings
from hypothesis import strategies as st

from api_schemas.policy import WeightsFormat
from services.errors import Refused, TooLarge
from services.policies.intake import check_weights, weights_format
from services.policies.safetensors_header import HEADER_LIMIT_BYTES, TENSOR_LIMIT, check_safetensors
from services.policies.unfit import UnfitError

GOOD = safetensors.numpy.save({"a": np.ones((2, 3), np.float32), "b": np.ones(4, np.float64)}, {"note": "x"})


def packed(header, data=b""):
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + data


def tensor(begin, end, dtype="F32", shape=None):
    return {"dtype": dtype, "shape": [(end - begin) // 4] if shape is None else shape, "data_offsets": [begin, end]}


def test_a_well_formed_file_passes():
    check_safetensors(GOOD)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"", "less than the 8"),
        (struct.pack("<Q", 2**63), "header has"),
        (struct.pack("<Q", HEADER_LIMIT_BYTES + 1) + b"x" * (HEADER_LIMIT_BYTES + 9), "header has"),
        (packed(b"{"), "not JSON"),
        (packed(b"[" * 100_000), "not JSON"),
        (packed(b"[]"), "not JSON"),
        (packed(b"{" + b"[" * 5000), "not JSON"),
        (packed({"__metadata__": {"a": 1}, "b": tensor(0, 4)}, b"1234"), "__metadata__"),
        (packed({"a": tensor(0, 8)}, np.array([1, np.nan], np.float32).tobytes()), "not finite"),
        (packed({"a": tensor(0, 4, "F16", [2])}, np.array([1, np.inf], np.float16).tobytes()), "not finite"),
        (packed({"a": tensor(0, 8, "F64", [1])}, np.array([-np.inf]).tobytes()), "not finite"),
        (packed(b"{}"), "0 tensors"),
        (packed({str(i): tensor(0, 0) for i in range(TENSOR_LIMIT + 1)}), f"1 to {TENSOR_LIMIT}"),
        (packed({"a": tensor(0, 8), "b": tensor(4, 12)}, b"x" * 12), "gaps and overlaps"),
        (packed({"a": tensor(0, 4), "b": tensor(8, 12)}, b"x" * 12), "gaps and overlaps"),
        (packed({"a": tensor(4, 8)}, b"x" * 8), "gaps and overlaps"),
        (packed({"a": tensor(0, 8)}, b"x" * 12), "12 follow"),
        (packed({"a": tensor(0, 8)}, b"x" * 4), "4 follow"),
        (packed({"a": tensor(0, 8, dtype="I64")}, b"x" * 8), "dtype"),
        (packed({"a": tensor(0, 8, dtype=["F32"])}, b"x" * 8), "dtype"),
        (packed({"a": tensor(0, 8, shape=[3])}, b"x" * 8), "does not fit"),
        (packed({"a": tensor(0, 8, shape=[-2])}, b"x" * 8), "whole numbers"),
        (packed({"a": tensor(0, 8, shape=[True, 2])}, b"x" * 8), "whole numbers"),
        (packed({"a": {"dtype": "F32"}}), "must have"),
        (packed({"a": 3}), "must have"),
        (
            packed(b'{"a":' + json.dumps(tensor(0, 4)).encode() + b',"a":' + json.dumps(tensor(0, 4)).encode() + b"}", b"1234"),
            "twice",
        ),
    ],
)
def test_malformed_files_are_refused(content, word):
    with pytest.raises(UnfitError, match=word):
        check_safetensors(content)


@settings(max_examples=300)
@given(st.data())
def test_mutations_are_refused_or_harmless(data):
    content = bytearray(GOOD)
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(content[: data.draw(st.integers(0, len(content)))])
    try:
        check_safetensors(cut)
    except UnfitError:
        return
    # What the check lets through the parser can read.
    safetensors.numpy.load(cut)


def test_size_is_checked_first(tmp_path):
    path = tmp_path / "w.onnx"
    path.write_bytes(b"x" * 11)
    with pytest.raises(Refused, match="not an ONNX file"):
        check_weights(path, WeightsFormat.ONNX, 11)
    with pytest.raises(TooLarge, match="11 bytes; at most 10"):
        check_weights(path, WeightsFormat.ONNX, 10)
    path.write_bytes(b"")
    with pytest.raises(Refused, match="empty"):
        check_weights(path, WeightsFormat.ONNX, 10)


@pytest.mark.parametrize(("name", "kind"), [("a.safetensors", "safetensors"), ("B.ONNX", "onnx"), ("c.zip", "zip")])
def test_the_form_is_known_by_name(name, kind):
    assert weights_format(name) == kind


@pytest.mark.parametrize("name", [None, "", "onnx", "a.json"])
def test_other_names_are_refused(name):
    with pytest.raises(Refused, match="must end in"):
        weights_format(name)


@pytest.mark.parametrize("name", ["a.pt", "a.pth", "a b.pkl", "vec_normalize.PKL", "a.pt2", "a.npz", "a.joblib", "a.ckpt"])
def test_names_of_formats_that_carry_code_are_refused_with_the_way_to_pack_them(name):
    with pytest.raises(Refused) as refusal:
        weights_format(name)
    quoted = f"'{name}'" if " " in name else name
    assert f"`trifarm pack {quoted}`" in refusal.value.detail
    assert (refusal.value.status, refusal.value.members["file"]) == (422, name)
