"""The farm's key: an Ed25519 key in the data folder that only its owner reads; it signs reports and seals sessions."""

import hashlib
import hmac
import os
from dataclasses import dataclass
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from trial_logs.disk import sync

KEY_FILE = "farm-key"
SEED_BYTES = 32


@dataclass(frozen=True)
class FarmKey:
    """One farm's key; its seed never leaves this process."""

    seed: bytes

    @classmethod
    def of(cls, data: Path, given: str | None = None) -> "FarmKey":
        """The key that is given, as 64 hexadecimal digits; without one that of the data folder, made at the first call.

        Processes that serve one farm from several folders must be given the same.

        Raises:
            ValueError: what is given, or the file that is there, holds no key.
        """
        if given is not None:
            return cls._read(given, "TRIFARM_FARM_KEY", "set")
        path = data / KEY_FILE
        if not path.exists():
            _make(path)
        return cls._read(path.read_text(), str(path), "restore the file or delete it for")

    @classmethod
    def _read(cls, text: str, where: str, do: str) -> "FarmKey":
        seed = key_bytes(text)
        if seed is None:
            raise ValueError(f"{where} holds no key of a farm, {SEED_BYTES} bytes in hexadecimal digits; {do} a new one")
        return cls(seed)

    @property
    def public_hex(self) -> str:
        """The public key, by which anybody checks a signature."""
        return self._private.public_key().public_bytes_raw().hex()

    def sign(self, content: bytes) -> str:
        """The signature of a content; the same content always has the same one."""
        return self._private.sign(content).hex()

    def secret_for(self, use: str) -> bytes:
        """A secret of 32 bytes for another use, from which nobody finds the key or the secret of a third."""
        return hmac.digest(self.seed, use.encode(), hashlib.sha256)

    @property
    def _private(self) -> Ed25519PrivateKey:
        return Ed25519PrivateKey.from_private_bytes(self.seed)


def key_bytes(text: str) -> bytes | None:
    """A key that was written as hexadecimal digits; None if the text holds none."""
    try:
        found = bytes.fromhex(text.strip())
    except ValueError:
        return None
    return found if len(found) == SEED_BYTES else None


def _make(path: Path) -> None:
    """Writes a new key under its name only when it is whole; of two processes that do so at once, one wins."""
    unfinished = path.with_suffix(f".{os.getpid()}.new")
    unfinished.unlink(missing_ok=True)  # of a process that had the same number and died
    with os.fdopen(os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(Ed25519PrivateKey.generate().private_bytes_raw().hex())
    sync(unfinished)
    try:
        os.link(unfinished, path)
        sync(path.parent)
    except FileExistsError:
        pass
    finally:
        unfinished.unlink()
