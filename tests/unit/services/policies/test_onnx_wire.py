from pathlib import Path

import onnx
import pytest
from onnx import defs, onnx_ml_pb2

from services.policies.onnx_wire import FIELD_LIMIT, MESSAGES, REFUSED, check_onnx
from services.policies.operators import ALLOWED
from services.policies.randomness import DRAWING
from services.policies.unfit import UnfitError
from tests.hostile.valid import onnx_file

PROTOS = {
    "Model": onnx.ModelProto,
    "OpsetId": onnx.OperatorSetIdProto,
    "Pair": onnx.StringStringEntryProto,
    "Graph": onnx.GraphProto,
    "Annotation": onnx_ml_pb2.TensorAnnotation,
    "Node": onnx.NodeProto,
    "Attribute": onnx.AttributeProto,
    "Tensor": onnx.TensorProto,
    "ValueInfo": onnx.ValueInfoProto,
    "Type": onnx.TypeProto,
    "TensorType": onnx.TypeProto.Tensor,
    "Shape": onnx.TensorShapeProto,
    "Dimension": onnx.TensorShapeProto.Dimension,
}
KINDS = {
    "varint": {3, 4, 5, 14}, "type": {5}, "location": {14}, "dims": {3}, "numbers": {3, 4, 5}, "fixed32": {2}, "numbers32": {2},
    "numbers64": {1}, "raw": {12}, "text": {9, 12}, "name": {9}, "operator": {9}, "domain": {9}, "empty": {9},
}  # fmt: skip
"""By how a value is written here, the numbers that protobuf has for such types."""


@pytest.mark.parametrize("message", MESSAGES)
def test_the_tables_are_those_of_onnx(message):
    fields = PROTOS[message].DESCRIPTOR.fields_by_number
    for number, kind in MESSAGES[message].items():
        if kind in MESSAGES:
            assert fields[number].message_type.name in PROTOS[kind].DESCRIPTOR.full_name
        else:
            assert fields[number].type in KINDS[kind], fields[number].name
    assert not set(MESSAGES[message]) & {number for name, number in REFUSED if name == message}


def test_the_operators_exist_and_none_draws():
    known = {schema.name for schema in defs.get_all_schemas_with_history() if schema.domain == ""}
    assert known >= ALLOWED
    assert not ALLOWED & DRAWING


def test_the_documented_operators_are_those_that_are_taken():
    page = (Path(__file__).resolve().parents[4] / "docs/policies.md").read_text()
    listed = page.partition("<!-- operators -->")[2].partition("<!-- end -->")[0]
    assert set(listed.split()) == ALLOWED


def test_a_valid_file_passes_and_every_cut_of_it_does_not():
    content = onnx_file()
    check_onnx(memoryview(content))
    for end in [*range(300), *range(300, len(content), 37)]:
        try:
            check_onnx(memoryview(content[:end]))
        except UnfitError as error:
            assert error.slug == "weights-malformed"
        else:
            # A cut between two fields of the whole leaves a shorter message; without opset it is no model.
            assert not onnx.load_model_from_string(content[:end]).opset_import


def test_what_was_read_is_given_back_now_and_then():
    given_back = []
    with pytest.raises(UnfitError, match=str(FIELD_LIMIT)):
        check_onnx(memoryview(b"\x08\x01" * (FIELD_LIMIT + 1)), lambda: given_back.append(1))
    assert len(given_back) == FIELD_LIMIT // 4096
