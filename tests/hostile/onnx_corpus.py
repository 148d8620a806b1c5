"""Graphs that look like policies and are not, and graphs that ask for more than they may have."""

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from tests.hostile.hostile_file import Hostile
from tests.hostile.valid import (
    onnx_file,
    onnx_model,
)


def onnx_files():
    def changed(change):
        model = onnx_model()
        change(model)
        return Hostile("p.onnx", model.SerializeToString(), "")

    def external(model):
        onnx.external_data_helper.set_external_data(model.graph.initializer[0], "/etc/passwd")

    def external_in_constant(model):
        tensor = numpy_helper.from_array(np.zeros(3, np.float32), "t")
        onnx.external_data_helper.set_external_data(tensor, "../../etc/passwd")
        model.graph.node.insert(0, helper.make_node("Constant", [], ["t"], value=tensor))

    def external_in_sparse(model):
        values = numpy_helper.from_array(np.zeros(3, np.float32), "s")
        onnx.external_data_helper.set_external_data(values, "/etc/passwd")
        indices = numpy_helper.from_array(np.arange(3), "i")
        model.graph.node.insert(0, helper.make_node("Constant", [], ["s"]))
        model.graph.node[0].attribute.append(
            helper.make_attribute("sparse_value", helper.make_sparse_tensor(values, indices, [9]))
        )

    def external_in_branch(model):
        inner = onnx_model().graph
        onnx.external_data_helper.set_external_data(inner.initializer[0], "/dev/zero")
        model.graph.node.append(helper.make_node("If", ["b"], ["z"], then_branch=inner, else_branch=inner))

    def location(model):
        model.graph.initializer[0].data_location = TensorProto.EXTERNAL

    def domain(model):
        model.graph.node[1].domain = "com.microsoft"

    def import_of(model):
        model.opset_import.append(helper.make_opsetid("evil", 1))

    def operator(name):
        def change(model):
            model.graph.node[1].op_type = name

        return change

    def functions(model):
        model.functions.append(helper.make_function("", "F", ["a"], ["b"], [], []))

    def deep(model):
        graph = onnx_model().graph
        for _ in range(20):
            outer = onnx_model().graph
            outer.node.append(helper.make_node("If", ["b"], ["z"], then_branch=graph))
            graph = outer
        model.graph.node.append(helper.make_node("If", ["b"], ["z"], then_branch=graph))

    def many(model):
        model.graph.node.extend([helper.make_node("Tanh", ["y"], [f"y{each}"]) for each in range(6000)])

    def texts(model):
        model.graph.initializer.append(helper.make_tensor("words", TensorProto.STRING, [1], [b"a"]))

    changes = {
        "external data": (external, "external-data"),
        "external data in a constant": (external_in_constant, "external-data"),
        "external data in a sparse tensor": (external_in_sparse, "onnx-part"),
        "external data in a branch": (external_in_branch, "external-data"),
        "external by its location": (location, "external-data"),
        "a library's operator": (domain, "onnx-operator"),
        "an imported domain": (import_of, "onnx-operator"),
        "chance": (operator("RandomNormalLike"), "onnx-operator"),
        "images": (operator("ImageDecoder"), "onnx-operator"),
        "texts by operator": (operator("StringConcat"), "onnx-operator"),
        "its own functions": (functions, "onnx-operator"),
        "deep graphs": (deep, "onnx-too-large"),
        "many nodes": (many, "onnx-too-large"),
        "texts": (texts, "onnx-part"),
    }
    made = {
        name: Hostile("p.onnx", changed(change).content, slug, packs=slug == "external-data")
        for name, (change, slug) in changes.items()
    }
    nan = onnx_model()
    nan.graph.initializer[0].CopyFrom(numpy_helper.from_array(np.full((8, 54), np.nan, np.float32), "w"))
    two = onnx_file() + onnx_file(1)
    varints = b"\x3a" + b"\xff\xff\xff\x7f" + b"\0" * 50
    return made | {
        "onnx cut short": Hostile("p.onnx", onnx_file()[:-3], "weights-malformed"),
        "two graphs": Hostile("p.onnx", two, "weights-malformed"),
        "a field longer than the file": Hostile("p.onnx", varints, "weights-malformed"),
        "endless number": Hostile("p.onnx", b"\x08" + b"\xff" * 40, "weights-malformed"),
        "a million fields": Hostile("p.onnx", b"\x08\x01" * 1_000_000, "onnx-too-large"),
        "unknown field": Hostile("p.onnx", onnx_file() + b"\xf8\x07\x01", "weights-malformed"),
        "group": Hostile("p.onnx", onnx_file() + b"\x0b\x0c", "weights-malformed"),
        "texts instead": Hostile("p.onnx", b"not onnx at all", "weights-malformed"),
        "NaN in onnx": Hostile("p.onnx", nan.SerializeToString(), "weights-not-finite", before_parsing=False),
    }


def greedy():
    """Graphs that ask for more than a conversion may have: when the runtime folds their constants, and when they run."""

    def of_size(shape):
        nodes = [
            helper.make_node("ConstantOfShape", ["shape"], ["zeros"]),
            helper.make_node("Sin", ["zeros"], ["sines"]),
            helper.make_node("ReduceMax", ["sines"], ["top"], keepdims=0),
            helper.make_node("Gemm", ["obs", "w", "b"], ["x"], transB=1),
            helper.make_node("Gemm", ["x", "v", "c"], ["y"], transB=1),
            helper.make_node("Add", ["y", "top"], ["act"]),
        ]
        model = onnx_model(nodes=nodes)
        model.graph.initializer.append(numpy_helper.from_array(np.array(shape, np.int64), "shape"))
        return model.SerializeToString()

    return {
        "256 GB when it runs": Hostile("p.onnx", of_size([2**36]), "dry-run-failed", before_parsing=False),
        "two times 512 MB when it is loaded": Hostile("p.onnx", of_size([2**27]), "conversion-failed", before_parsing=False),
    }
