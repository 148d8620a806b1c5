"""The public keys of the farms that this user knows; each is kept when it is first seen, and must not change after."""

import json
import os
import re
from pathlib import Path

from client_cli.terminal.errors import ClientError, UsageProblem

KEYS_FILE = "farm-keys.json"
_KEY = re.compile(r"[0-9a-f]{64}")


def known_keys(home: Path) -> dict[str, str]:
    """The farms' addresses by their keys."""
    return {key: f"the key of {url}" for url, key in _stored(home).items()}


def keep_key(home: Path, url: str, key: str) -> None:
    """Keeps a farm's key at its first sight.

    Raises:
        ClientError: the farm had another key before.
    """
    stored = _stored(home)
    if stored.get(url, key) != key:
        raise ClientError(
            f"{url} signs with the key {key}, but did so with {stored[url]} before: it is another farm, or somebody stands "
            f"between; if you know why, remove its line from {home / KEYS_FILE}"
        )
    if url in stored:
        return
    home.mkdir(parents=True, exist_ok=True)
    temporary = home / f"{KEYS_FILE}.{os.getpid()}.tmp"
    temporary.write_text(json.dumps(stored | {url: key}, indent=2) + "\n")
    temporary.replace(home / KEYS_FILE)


def given_key(text: str) -> str:
    """A key that was given as such, or as a file that holds it.

    Raises:
        UsageProblem: it is neither.
    """
    path = Path(text)
    found = path.read_text().strip() if len(text) < 256 and path.is_file() else text.strip()
    if not _KEY.fullmatch(found):
        raise UsageProblem(f"{text!r} is neither a farm's key (64 hexadecimal digits) nor a file with one")
    return found


def _stored(home: Path) -> dict[str, str]:
    path = home / KEYS_FILE
    try:
        stored = json.loads(path.read_text())
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise UsageProblem(f"cannot read the farms' keys in {path}: {error}") from error
    if not isinstance(stored, dict) or not all(isinstance(key, str) and _KEY.fullmatch(key) for key in stored.values()):
        raise UsageProblem(f"{path} is not a file of farms and their keys; repair or delete it")
    return stored
