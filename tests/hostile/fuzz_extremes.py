"""Every route with values at the edges of numbers, texts and documents, under every kind of token: no answer is a 500.

``python -m tests.hostile.fuzz_extremes --cases 20000 --seed 1 2 --out FILE`` takes the routes from the document that a real
services process serves and makes each request of one that is valid: some of its values are replaced, or the body, a header or the
token. schemathesis (``fuzz_api``) compares answers with the document; here only their status counts, so that more is tried.
"""

import argparse
import copy
import json
import random
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx

from tests.hostile.fuzz_api import SETTINGS, things
from tests.integration.farm_process import services

NUMBERS = (
    0,
    -1,
    1,
    2**31 - 1,
    2**31,
    -(2**31) - 1,
    2**53 + 1,
    2**63 - 1,
    2**63,
    -(2**63) - 1,
    2**64,
    10**30,
    10**400,
    1e308,
    1e-320,
    0.5,
)
TEXTS = (
    *(
        "",
        " ",
        "\x00",
        "a\x00b",
        "\ud800",
        "\u202e",
        "\u200b",
        "\ufeff",
        "x" * 5000,
        "'",
        '"; DROP TABLE job; --',
        "%s%n",
        "../../etc/passwd",
    ),
    *(
        "\U0001f916" * 40,
        "null",
        "true",
        "NaN",
        "-0",
        "1e999",
        "2026-13-45T99:99:99Z",
        "٣",
        "İ",
        "a" * 64,
        "0" * 64,
        "robot-0",
        "{}",
        "\r\nX: y",
    ),
)
STRANGE: tuple[Any, ...] = (
    *NUMBERS,
    *TEXTS,
    None,
    True,
    False,
    [],
    {},
    [None],
    [[[[[]]]]],
    {"": 0},
    [0] * 3000,
    {"a": {"b": {"c": []}}},
)
RAW = (
    b"",
    b"\x00",
    b"{",
    b"[" * 900,
    b'{"a":' * 400,
    b"\xff\xfe",
    b"NaN",
    b"[Infinity]",
    b'{"a":1,"a":2}',
    b"1" * 5000,
    b'"\\ud800"',
    b"\x1f\x8b\x08",
)
MEDIA = (
    "application/json",
    "text/plain",
    "multipart/form-data; boundary=b",
    "application/x-www-form-urlencoded",
    "application/octet-stream",
    "",
    "a/b;c",
)
HEADERS = (
    *(
        "Idempotency-Key",
        "If-None-Match",
        "If-Range",
        "Range",
        "Last-Event-ID",
        "X-Content-SHA256",
        "X-Forwarded-For",
        "Accept",
        "Cookie",
    ),
    *("Accept-Encoding", "Content-Encoding", "Expect", "Origin", "Host"),
)
WAITS = ("/history", "/events")
"""Routes that wait for what comes next: nobody waits for long."""
PATIENCE_S = {False: 60.0, True: 0.3}
METHODS = frozenset({"get", "head", "post", "put", "delete", "patch"})
AT_ONCE, REPORTED, DEEPEST = 4, 20, 5
WORDS = ("a", "robot-0", "0" * 64, "push")


class Cases:
    """Draws requests; owner of the generator.

    Args:
        document: of the API.
        ids: of what exists, by the name of a path's parameter.
        tokens: by kind.
        seed: of what is drawn.
    """

    def __init__(self, document: dict[str, Any], ids: dict[str, list[Any]], tokens: dict[str, str], seed: int) -> None:
        self._rng, self._ids, self._tokens = random.Random(f"extremes-{seed}"), ids, tokens
        self._components = document["components"]["schemas"]
        self._operations = [
            (method, path, operation)
            for path, operations in sorted(document["paths"].items())
            for method, operation in sorted(operations.items())
            if method in METHODS
        ]

    def __len__(self) -> int:
        """How many operations there are."""
        return len(self._operations)

    def drawn(self, number: int) -> dict[str, Any]:
        """One request; every operation comes again and again."""
        rng, (method, path, operation) = self._rng, self._operations[number % len(self._operations)]
        filled, query, headers = path, {}, {}
        for parameter in operation.get("parameters", ()):
            name, value = parameter["name"], self._parameter(parameter)
            if parameter["in"] == "path":
                filled = filled.replace(f"{{{name}}}", _quoted(value))
            elif parameter["in"] == "query" and rng.random() < 0.6:
                query[name] = value
        for name in rng.sample(HEADERS, rng.choice((0, 0, 0, 1, 2))):
            headers[name] = _header(rng.choice(STRANGE))
        kind = rng.choices(sorted(self._tokens), [4 if each in ("admin", "robot") else 1 for each in sorted(self._tokens)])[0]
        if self._tokens[kind]:
            headers["Authorization"] = f"Bearer {self._tokens[kind]}"
        content, media = self._body(operation)
        if media:
            headers["Content-Type"] = media
        return {
            "operation": f"{method.upper()} {path}",
            "waits": path.endswith(WAITS),
            "token": kind,
            "request": {"method": method.upper(), "url": filled, "params": query, "headers": headers, "content": content},
        }

    def _parameter(self, parameter: dict[str, Any]) -> Any:
        if parameter["in"] == "path" and self._rng.random() < 0.8:
            return self._rng.choice(self._ids[parameter["name"]])
        return self._rng.choice(STRANGE)

    def _body(self, operation: dict[str, Any]) -> tuple[bytes | None, str]:
        """The bytes and what they are said to be."""
        rng, asked = self._rng, operation.get("requestBody", {}).get("content", {})
        if not asked:
            return (rng.choice(RAW), rng.choice(MEDIA)) if rng.random() < 0.1 else (None, "")
        if "application/json" not in asked or rng.random() < 0.1:
            return rng.choice(RAW), rng.choice((*MEDIA, *asked))
        valid = self._valid(asked["application/json"]["schema"])
        for _ in range(rng.choice((0, 1, 1, 1, 2, 3))):
            valid = self._changed(valid)
        return json.dumps(valid).encode(), "application/json" if rng.random() < 0.95 else rng.choice(MEDIA)

    def _valid(self, schema: dict[str, Any], depth: int = 0) -> Any:
        """Something of the kind that a schema describes, ids of what exists among it."""
        rng = self._rng
        if "$ref" in schema:
            schema = self._components[schema["$ref"].rpartition("/")[2]]
        for several in ("anyOf", "oneOf", "allOf"):
            if several in schema:
                return self._valid(rng.choice(schema[several]), depth)
        if "enum" in schema or "const" in schema:
            return rng.choice(schema.get("enum", [schema.get("const")]))
        if schema.get("type") == "object":
            named = schema.get("properties", {})
            wanted = [name for name in named if name in schema.get("required", ()) or rng.random() < 0.5]
            return {name: self._of_name(name, named[name], depth + 1) for name in wanted}
        if schema.get("type") == "array":
            few = schema.get("prefixItems") or [schema.get("items", {})] * (0 if depth > DEEPEST else rng.choice((1, 1, 2)))
            return [self._valid(each, depth + 1) for each in few]
        small, large = schema.get("minimum", 0), schema.get("maximum", 5)
        plain = {"integer": (small, large, 1), "number": (small, large, 0.5), "boolean": (True, False), "string": WORDS}
        return rng.choice(plain.get(schema.get("type", ""), (None,)))

    def _of_name(self, name: str, schema: dict[str, Any], depth: int) -> Any:
        existing = self._ids.get({"policy": "digest"}.get(name, name))
        return self._rng.choice(existing) if existing and self._rng.random() < 0.9 else self._valid(schema, depth)

    def _changed(self, value: Any) -> Any:
        """The same, with one value in it replaced, added or left out."""
        rng = self._rng
        if isinstance(value, dict) and value and rng.random() < 0.9:
            changed, name = copy.copy(value), rng.choice(sorted(value))
            if rng.random() < 0.1:
                del changed[name]
            elif rng.random() < 0.05:
                changed[str(rng.choice(TEXTS))] = rng.choice(STRANGE)
            else:
                changed[name] = self._changed(value[name])
            return changed
        if isinstance(value, list) and value and rng.random() < 0.7:
            index = rng.randrange(len(value))
            return [*value[:index], self._changed(value[index]), *value[index + 1 :]]
        return copy.copy(rng.choice(NUMBERS if isinstance(value, int | float) and rng.random() < 0.6 else STRANGE))


def _quoted(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return "".join(f"%{byte:02X}" for byte in text.encode(errors="surrogatepass"))[:3000] or "%20"


def _header(value: Any) -> bytes:
    text = value if isinstance(value, str) else json.dumps(value)
    return text.encode(errors="surrogatepass").replace(b"\r", b"").replace(b"\n", b"").replace(b"\x00", b"")[:4000]


def ask(client: httpx.Client, case: dict[str, Any]) -> str:
    """The status of the answer, or why there is none."""
    request = case["request"] | {"params": {name: _text(value) for name, value in case["request"]["params"].items()}}
    try:
        with client.stream(**request, timeout=PATIENCE_S[case["waits"]]) as answer:
            return str(answer.status_code)
    except httpx.TimeoutException:
        return "waited" if case["waits"] else "no answer"
    except (httpx.RemoteProtocolError, httpx.LocalProtocolError, httpx.ReadError, httpx.WriteError):
        return "no HTTP"  # what was sent was none, and the connection was closed for it


def _text(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text.encode(errors="replace").decode()[:3000]


def fuzz(farm, cases: int, seed: int) -> dict[str, Any]:
    """So many requests; what they were answered, and those that got a 500 or no answer."""
    ids = things(farm)
    tokens = {
        "admin": farm.admin.post("/v1/tokens", json={"owner": "fuzz", "scopes": ["admin"]}).json()["secret"],
        "user": farm.admin.post("/v1/tokens", json={"owner": "ann", "scopes": ["submit"]}).json()["secret"],
        "operator": farm.admin.post("/v1/tokens", json={"owner": "op", "scopes": ["operate"]}).json()["secret"],
        "robot": farm.admin.post("/v1/robots/robot-0/token").json()["secret"],
        "none": "",
        "unknown": "trifarm_x_y",
    }
    document = farm.admin.get("/openapi.json").json()
    drawing = Cases(document, ids, tokens, seed)
    drawn = [drawing.drawn(number) for number in range(cases)]
    answers, by_operation, wrong = Counter[str](), Counter[str](), []
    began_s = time.monotonic()
    with httpx.Client(base_url=farm.api, trust_env=False) as client, ThreadPoolExecutor(AT_ONCE) as pool:
        for case, status in zip(drawn, pool.map(lambda each: ask(client, each), drawn), strict=True):
            answers[status] += 1
            by_operation[case["operation"]] += 1
            if status in {"500", "no answer"}:
                wrong.append({"status": status, **case, "request": repr(case["request"])[:1000]})
    assert farm.process.poll() is None, "the services ended"
    return {
        "seed": seed,
        "cases": cases,
        "operations": len(by_operation),
        "of_operations": len(drawing),
        "statuses": dict(sorted(answers.items())),
        "answers_of_500": answers["500"],
        "wrong": wrong[:REPORTED],
        "healthy_afterwards": farm.admin.get("/healthz").status_code == 200,
        "seconds": round(time.monotonic() - began_s, 1),
    }


def main() -> int:
    """Writes what was found; code 1 where an answer was a 500."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--seed", type=int, nargs="+", default=[1])
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    runs = []
    for seed in given.seed:
        with tempfile.TemporaryDirectory() as folder, services(Path(folder) / "farm", **SETTINGS) as farm:
            runs.append(fuzz(farm, given.cases, seed))
        given.out.write_text(json.dumps({"runs": runs}, indent=1) + "\n")
    return int(any(run["answers_of_500"] or not run["healthy_afterwards"] for run in runs))


if __name__ == "__main__":
    sys.exit(main())
