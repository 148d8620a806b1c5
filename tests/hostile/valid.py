"""Small valid files of each kind that the server takes, made without the libraries that usually write them."""

import io
import json
import pickle
import struct
import zipfile
from pathlib import Path

import numpy as np
import safetensors.numpy
from onnx import TensorProto, helper, numpy_helper

from api_schemas.policy import LAYOUTS, OutputScaling

MANIFEST = LAYOUTS["rrc2022-push"].model_copy(update={"output_scaling": OutputScaling(clip=1.0, scale=0.36)})
SIZE, WIDTH = 54, 8


def weights(seed=0, width=WIDTH):
    rng = np.random.default_rng(seed)
    shapes = [(width, SIZE), (width,), (9, width), (9,)]
    return [rng.normal(0, 0.1, shape).astype(np.float32) for shape in shapes]


def safetensors_file(seed=0):
    names = ("layer0.weight", "layer0.bias", "layer1.weight", "layer1.bias")
    return safetensors.numpy.save(dict(zip(names, weights(seed), strict=True)))


def onnx_model(seed=0, nodes=None, constants=None):
    first, first_bias, second, second_bias = constants or weights(seed)
    tensors = [
        numpy_helper.from_array(each, name) for each, name in ((first, "w"), (first_bias, "b"), (second, "v"), (second_bias, "c"))
    ]
    usual = [
        helper.make_node("Gemm", ["obs", "w", "b"], ["x"], transB=1),
        helper.make_node("Tanh", ["x"], ["y"]),
        helper.make_node("Gemm", ["y", "v", "c"], ["act"], transB=1),
    ]
    given = helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, SIZE])
    gives = helper.make_tensor_value_info("act", TensorProto.FLOAT, [1, 9])
    graph = helper.make_graph(nodes or usual, "net", [given], [gives], tensors)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)


def onnx_file(seed=0):
    return onnx_model(seed).SerializeToString()


SB3_NAMES = (
    "mlp_extractor.policy_net.0.weight",
    "mlp_extractor.policy_net.0.bias",
    "action_net.weight",
    "action_net.bias",
)


class Storage:
    """Pickled by reference, as torch does it."""

    def __init__(self, key, count):
        self.key, self.count = key, count


def state_dict_pickle(tensors):
    """The pickle that torch.save makes of a state_dict: written opcode by opcode."""
    out = io.BytesIO()
    out.write(b"\x80\x02ccollections\nOrderedDict\n)R(")
    for key, (name, array) in enumerate(tensors.items()):
        strides = [each // array.itemsize for each in array.strides]
        out.write(text(name) + b"ctorch._utils\n_rebuild_tensor_v2\n((" + text("storage") + b"ctorch\nFloatStorage\n")
        out.write(text(str(key)) + text("cpu") + number(array.size) + b"tQ" + number(0))
        out.write(b"(" + b"".join(map(number, array.shape)) + b"t(" + b"".join(map(number, strides)) + b"t\x89")
        out.write(b"ccollections\nOrderedDict\n)RtR")
    return out.getvalue() + b"u."


def text(value):
    return b"X" + struct.pack("<I", len(value)) + value.encode()


def number(value):
    return b"J" + struct.pack("<i", value)


def entries_of_torch_file(tensors, pickled=None):
    entries = {"archive/data.pkl": state_dict_pickle(tensors) if pickled is None else pickled, "archive/byteorder": b"little"}
    entries |= {f"archive/data/{key}": array.tobytes() for key, array in enumerate(tensors.values())}
    return entries | {"archive/version": b"3\n"}


def torch_file(tensors, pickled=None):
    return zipped(entries_of_torch_file(tensors, pickled))


def torch_entries(seed=0):
    return entries_of_torch_file(dict(zip(SB3_NAMES, weights(seed), strict=True)))


DATA = {
    "policy_class": {":type:": "<class 'abc.ABCMeta'>", ":serialized:": "gASVOwAAAAAAAACMIXN0YWJsZV9iYXNlbGluZXMz"},
    "policy_kwargs": {},
    "action_space": {
        ":type:": "<class 'gymnasium.spaces.box.Box'>",
        ":serialized:": "gAU=",
        "low": str(-np.ones(9)),
        "high": str(np.ones(9)),
    },
}


def sb3_entries(seed=0, pickled=None):
    """The entries of an archive as stable-baselines3 writes it; ``pickled`` takes the place of the list of tensors."""
    tensors = dict(zip(SB3_NAMES, weights(seed), strict=True))
    return {
        "data": json.dumps(DATA).encode(),
        "pytorch_variables.pth": b"",
        "policy.pth": torch_file(tensors, pickled),
        "_stable_baselines3_version": b"2.9.2",
        "system_info.txt": b"- OS: none\n",
    }


def zipped(entries, method=zipfile.ZIP_STORED):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    return out.getvalue()


def sb3_file(seed=0):
    return zipped(sb3_entries(seed))


VALID = {"safetensors": safetensors_file, "onnx": onnx_file, "zip": sb3_file}
"""By the end of the file's name."""


class Canary:
    """Unpickled, it writes a file and calls at a socket: whoever does it has run a stranger's code."""

    def __init__(self, path, port):
        self.path, self.port = str(path), port

    def __reduce__(self):
        code = (
            f"import pathlib, socket; pathlib.Path({self.path!r}).write_text('fired'); "
            f"socket.create_connection(('127.0.0.1', {self.port}), 2).close()"
        )
        return exec, (code,)


def canary_pickle(path: Path, port: int, protocol=2):
    return pickle.dumps(Canary(path, port), protocol)


def sized(kind, size_bytes, seed=0):
    """A valid file of about so many bytes: one hidden layer, as wide as it takes."""
    tensors = weights(seed, width=size_bytes // 4 // (SIZE + 1 + 9))
    if kind == "safetensors":
        names = ("layer0.weight", "layer0.bias", "layer1.weight", "layer1.bias")
        return safetensors.numpy.save(dict(zip(names, tensors, strict=True)))
    if kind == "onnx":
        return onnx_model(constants=tensors).SerializeToString()
    return zipped(sb3_entries() | {"policy.pth": torch_file(dict(zip(SB3_NAMES, tensors, strict=True)))})
