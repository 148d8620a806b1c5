"""The address of a webhook: https, a host and a path, and nothing that hides what it leads to."""

from typing import Annotated
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field

MAX_URL = 500
PORTS = (443, 8443)
"""Those of https; by any other a farm could be had to knock at the doors of other services."""


def _https(url: str) -> str:
    if not (url.isascii() and url.isprintable()) or any(each in url for each in ' \\"<>'):
        raise ValueError("a webhook's address has ASCII characters only, and none of space, backslash, quote and < >")
    parts = urlsplit(url)
    if parts.scheme != "https" or not parts.hostname:
        raise ValueError(f"a webhook's address begins with https:// and a host, this one with {url[:20]!r}")
    if parts.username is not None or parts.password is not None:
        raise ValueError("a webhook's address holds no user and no password; put a secret word into its path")
    if parts.port is not None and parts.port not in PORTS:
        raise ValueError(f"a webhook's port is 443 or 8443, not {parts.port}")
    return url


WebhookUrl = Annotated[str, Field(max_length=MAX_URL), AfterValidator(_https)]
