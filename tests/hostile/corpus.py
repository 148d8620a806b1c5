"""Files that look like policies and are not: each with the type of the problem that it must meet."""

import io
import json
import struct
import zipfile
import zlib

import numpy as np
import safetensors.numpy

from tests.hostile.hostile_file import LATE, Hostile
from tests.hostile.onnx_corpus import greedy, onnx_files
from tests.hostile.valid import (
    SB3_NAMES,
    canary_pickle,
    onnx_file,
    safetensors_file,
    sb3_entries,
    sb3_file,
    torch_file,
    weights,
    zipped,
)


def corpus(canary, port):
    """Every hostile file by a name of its own; what runs code writes to ``canary`` and calls at ``port``."""
    return {**pickles(canary, port), **bombs(), **paths(), **headers(), **onnx_files(), **greedy(), **archives()}


def pickles(canary, port):
    fires = canary_pickle(canary, port)
    other = {f"pickle protocol {each}": canary_pickle(canary, port, each) for each in range(5)}
    entries = sb3_entries()
    made = {
        f"{name} as {suffix}": Hostile(f"p.{suffix}", content, "pickle", packs=True)
        for name, content in other.items()
        for suffix in ("safetensors", "onnx", "zip")
    }
    for suffix in ("pkl", "pt", "pth", "pt2", "ckpt"):
        made[f"pickle named {suffix}"] = Hostile(f"p.{suffix}", fires, "unknown-weights-format", packs=True)
    made |= {
        "pickle as policy.pth": Hostile("p.zip", zipped(entries | {"policy.pth": fires}), "archive-malformed"),
        "pickle in policy.pth": Hostile("p.zip", zipped(sb3_entries(pickled=fires)), "pickle", packs=True, before_parsing=False),
        "pickle as data": Hostile("p.zip", zipped(entries | {"data": fires}), "archive-malformed", packs=True, **LATE),
        "VecNormalize beside": Hostile("p.zip", zipped(entries | {"vec_normalize.pkl": fires}), "archive-entry", packs=True),
        "torch checkpoint": Hostile("p.zip", torch_file({}, fires), "pickle", packs=True),
        "TorchScript": Hostile(
            "p.zip", zipped({"m/data.pkl": fires, "m/constants.pkl": fires, "m/code/a.py": b""}), "torchscript", packs=True
        ),
        "TorchScript as policy.pth": Hostile(
            "p.zip",
            zipped(entries | {"policy.pth": zipped({"m/data.pkl": fires, "m/code/a.py": b""})}),
            "torchscript",
            packs=True,
        ),
        "torch.export": Hostile(
            "p.zip", zipped({"m/archive_format": b"pt2", "m/models/model.json": b"{}", "m/data/w.pkl": fires}), "torch-export",
            packs=True,
        ),
        "zip as onnx": Hostile("p.onnx", sb3_file(), "wrong-format", packs=True),
        "zip as safetensors": Hostile("p.safetensors", torch_file({}, fires), "wrong-format", packs=True),
    }  # fmt: skip
    return made | {f"opcodes {name}": each for name, each in opcodes().items()}


def opcodes():
    """Pickles that call or name something, without any of the usual ends."""
    programs = {
        "a global of os": b"\x80\x02cos\nsystem\n.",
        "a global on the stack": b"\x80\x04\x8c\x02os\x8c\x06system\x93.",
        "an instance": b"\x80\x02(ios\nsystem\n.",
        "an extension": b"\x80\x02\x82\x01.",
        "text evaluated by a long": b"\x80\x02L99L\n.",
        "no end": b"\x80\x02}",
        "an empty stack": b"\x80\x02.",
        "a mark too few": b"\x80\x02t.",
        "no dictionary": b"\x80\x02K\x01.",
        "a rebuilt call": b"\x80\x02ccollections\nOrderedDict\nK\x01\x85R.",
    }
    return {
        name: Hostile("p.zip", zipped(sb3_entries(pickled=program)), "", packs=True, before_parsing=False)
        for name, program in programs.items()
    }


def bombs():
    zeros = zlib.compressobj(9, zlib.DEFLATED, -15)
    packed = zeros.compress(b"\0" * 50_000_000) + zeros.flush()
    deflated = zipped(sb3_entries() | {"data": b" " * 4_000_000}, zipfile.ZIP_DEFLATED)
    many = io.BytesIO()
    with zipfile.ZipFile(many, "w") as archive:
        for each in range(70):
            archive.writestr(f"{each}", b"")
    return {
        "ratio": Hostile("p.zip", deflated, "archive-too-large"),
        "lies about its size": Hostile("p.zip", lying(packed, 60_000), "archive-malformed", before_parsing=False),
        "a million entries": Hostile("p.zip", entry_count(zipped({"data": b""}), 10**6 % 65536), "archive-too-large"),
        "many entries": Hostile("p.zip", many.getvalue(), "archive-too-large"),
        "huge declared": Hostile("p.zip", huge_declared(), "archive-too-large"),
        "nested": Hostile("p.zip", zipped(sb3_entries() | {"data.zip": zipped({"a": b"b" * 1000})}), "archive-entry", packs=True),
        "nested in policy.pth": Hostile(
            "p.zip", zipped(sb3_entries() | {"policy.pth": zipped({"more.zip": zipped({"a": b""})})}), "archive-malformed"
        ),
        "overlapping entries": Hostile("p.zip", overlapping(), "archive-malformed"),
    }


def huge_declared():
    """The directory says that two megabytes become 140, which no ratio forbids."""
    entries = sb3_entries() | {"pytorch_variables.pth": np.random.default_rng(0).bytes(2_000_000)}
    content = bytearray(zipped(entries, zipfile.ZIP_DEFLATED))
    at = content.rfind(b"pytorch_variables.pth") - 46
    struct.pack_into("<I", content, at + 24, 140_000_000)
    return bytes(content)


def lying(packed, said):
    """``data`` inflates to far more than its headers say."""
    content = bytearray(zipped(sb3_entries() | {"data": b"\0" * said}, zipfile.ZIP_DEFLATED))
    honest = zipfile.ZipFile(io.BytesIO(bytes(content))).getinfo("data")
    begin = 30 + len("data")
    content[begin : begin + honest.compress_size] = packed
    grown = len(packed) - honest.compress_size
    content[18:22] = struct.pack("<I", len(packed))
    end = content.rfind(b"PK\5\6")
    (start,) = struct.unpack_from("<I", content, end + 16)
    struct.pack_into("<I", content, end + 16, start + grown)
    at = start + grown
    struct.pack_into("<I", content, at + 20, len(packed))
    for _ in range(len(sb3_entries()) - 1):
        at += 46 + sum(struct.unpack_from("<3H", content, at + 28))
        (header_at,) = struct.unpack_from("<I", content, at + 42)
        struct.pack_into("<I", content, at + 42, header_at + grown)
    return bytes(content)


def entry_count(content, count):
    content = bytearray(content)
    end = content.rfind(b"PK\5\6")
    struct.pack_into("<2H", content, end + 8, count, count)
    return bytes(content)


def overlapping():
    """Two entries of the directory share one place."""
    content = bytearray(zipped({"data": b"x" * 100, "dat2": b"x" * 100}))
    end = content.rfind(b"PK\5\6")
    (start,) = struct.unpack_from("<I", content, end + 16)
    struct.pack_into("<I", content, start + 46 + 4 + 42, 0)
    return bytes(content)


def paths():
    def with_entry(name, mode=None, flag=0):
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w") as archive:
            for each, content in sb3_entries().items():
                archive.writestr(each, content)
            info = zipfile.ZipInfo("placeholder")
            info.external_attr = (mode or 0o600) << 16
            archive.writestr(info, b"/etc/passwd")
        content = out.getvalue().replace(b"placeholder", name.ljust(11, b"_"))
        if flag:
            start = content.rfind(b"PK\1\2")
            content = content[: start + 8] + struct.pack("<H", flag) + content[start + 10 :]
        return content

    doubled = zipped(sb3_entries() | {"dbta": b"{}"}).replace(b"dbta", b"data")
    return {
        "dots": Hostile("p.zip", with_entry(b"../../../a"), "archive-path"),
        "absolute": Hostile("p.zip", with_entry(b"/etc/passwd"), "archive-path"),
        "drive": Hostile("p.zip", with_entry(b"C:\\windows\\"), "archive-path"),
        "empty part": Hostile("p.zip", with_entry(b"a//b"), "archive-path"),
        "nul": Hostile("p.zip", with_entry(b"a\0b"), "archive-path"),
        "not ASCII": Hostile("p.zip", with_entry(b"a\xff"), "archive-path"),
        "link": Hostile("p.zip", with_entry(b"policy", 0o120777), "archive-path"),
        "device": Hostile("p.zip", with_entry(b"policy", 0o020666), "archive-path"),
        "encrypted": Hostile("p.zip", with_entry(b"policy", flag=1), "archive-encrypted"),
        "twice the same name": Hostile("p.zip", doubled, "archive-malformed"),
    }


def headers():
    def packed(header, data=b"", length=None):
        text = header if isinstance(header, bytes) else json.dumps(header).encode()
        return struct.pack("<Q", len(text) if length is None else length) + text + data

    def tensor(begin, end, shape=None, dtype="F32"):
        return {"dtype": dtype, "shape": [(end - begin) // 4] if shape is None else shape, "data_offsets": [begin, end]}

    nan = safetensors.numpy.save({"layer0.weight": np.full((9, 54), np.nan, np.float32)})
    large = safetensors.numpy.save({"a": np.append(np.zeros(15 * 2**20, np.float32), np.float32(np.inf))})
    made = {
        "length of 2^63": packed(b"{}", length=2**63),
        "header of 100 MB": packed(b"{}" + b" " * 2_000_000, length=100_000_000),
        "many tensors": packed({f"t{each}": tensor(0, 0, [0]) for each in range(9000)}),
        "deep lists": packed(b'{"a":' + b"[" * 900_000),
        "deep objects": packed(b'{"a":' * 150_000),
        "many small objects": packed(b'{"a":[' + b"{}," * 300_000 + b"{}]}"),
        "many numbers": packed(b'{"a":[' + b"1," * 500_000 + b"1]}"),
        "overlap": packed({"a": tensor(0, 8), "b": tensor(4, 12)}, b"\0" * 12),
        "gap": packed({"a": tensor(0, 4), "b": tensor(8, 12)}, b"\0" * 12),
        "dtype": packed({"a": tensor(0, 8, dtype="I64")}, b"\0" * 8),
        "huge shape": packed({"a": tensor(0, 8, [2**40, 2**40])}, b"\0" * 8),
        "empty shape": packed({"a": tensor(0, 8, [2**40, 0])}, b"\0" * 8),
        "twice": packed(json.dumps({"a": tensor(0, 4), "b": tensor(0, 4)}).replace('"b"', '"a"').encode(), b"1234"),
        "cut short": safetensors_file()[:-1],
        "more behind": safetensors_file() + b"\0",
    }  # fmt: skip
    files = {name: Hostile("p.safetensors", content, "weights-malformed") for name, content in made.items()}
    return files | {
        "no number": Hostile("p.safetensors", nan, "weights-not-finite"),
        "no number at the end of 60 MB": Hostile("p.safetensors", large, "weights-not-finite"),
        "empty": Hostile("p.safetensors", b"", "weights-empty"),
        "too large": Hostile("p.safetensors", b"\0" * (64 * 2**20 + 1), "weights-too-large"),
    }


def archives():
    tensors = dict(zip(SB3_NAMES, weights(), strict=True))

    def archive(changed, data=None):
        entries = sb3_entries() | {"policy.pth": torch_file(changed)}
        return zipped(entries if data is None else entries | {"data": data})

    without = {name: each for name, each in tensors.items() if name != "action_net.bias"}
    nan = tensors | {"action_net.bias": np.full(9, np.nan, np.float32)}
    sizes = tensors | {"action_net.weight": np.zeros((9, 7), np.float32)}
    normed = tensors | {"mlp_extractor.policy_net.1.weight": np.zeros(8, np.float32)}
    recurrent = tensors | {"lstm_actor.weight_ih_l0": np.zeros((8, 54), np.float32)}
    images = tensors | {"features_extractor.cnn.0.weight": np.zeros((8, 3), np.float32)}
    return {
        "archive cut short": Hostile("p.zip", sb3_file()[:-30], "archive-malformed"),
        "archive with more behind": Hostile("p.zip", sb3_file() + b"PK", "archive-malformed"),
        "archive with more in front": Hostile("p.zip", b"PK\3\4" + sb3_file(), "archive-malformed"),
        "no policy": Hostile("p.zip", zipped({"data": b"{}"}), "archive-entry", packs=True),
        "no archive": Hostile("p.zip", onnx_file(), "archive-malformed"),
        "a tensor missing": Hostile("p.zip", archive(without), "network-unknown", packs=True, **LATE),
        "no number in a tensor": Hostile("p.zip", archive(nan), "weights-not-finite", **LATE),
        "shapes that do not fit": Hostile("p.zip", archive(sizes), "weights-malformed", **LATE),
        "a norm between": Hostile("p.zip", archive(normed), "network-unknown", packs=True, **LATE),
        "recurrent": Hostile("p.zip", archive(recurrent), "network-unknown", packs=True, **LATE),
        "a network for images": Hostile("p.zip", archive(images), "network-unknown", packs=True, **LATE),
        "no action space": Hostile("p.zip", archive(tensors, b"{}"), "action-does-not-fit", packs=True, **LATE),
        "deep data": Hostile("p.zip", archive(tensors, b"[" * 100_000), "archive-malformed", packs=True, **LATE),
    }
