"""Where the server is and who asks: TRIFARM_URL, _TOKEN and _CA, else the settings file that ``trifarm up`` wrote."""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

import typer

from client_cli.terminal.errors import UsageProblem

DEFAULT_PORT = 8787
PORTS = {"http": 80, "https": 443}
DEFAULT_URL = f"http://127.0.0.1:{DEFAULT_PORT}"


@dataclass(frozen=True)
class Connection:
    """Address of the server and the bearer token to show it; without a token only /healthz answers.

    ``ca`` is a PEM file with the certificates that vouch for the server's, instead of those that this machine trusts.
    """

    url: str
    token: str | None = field(repr=False)
    ca: str | None = None


def home_folder(environ: Mapping[str, str]) -> Path:
    """TRIFARM_HOME, or trifarm's folder among the user's configuration."""
    named = environ.get("TRIFARM_HOME")
    return Path(named).expanduser() if named else Path(typer.get_app_dir("trifarm"))


def default_data_folder(environ: Mapping[str, str]) -> Path:
    """Where ``up`` keeps a farm's data: inside TRIFARM_HOME if that is set, else among the user's data.

    Logs grow to gigabytes, which do not belong in a configuration folder.
    """
    if environ.get("TRIFARM_HOME"):
        return home_folder(environ) / "farm"
    data_home = environ.get("XDG_DATA_HOME")
    return (Path(data_home) if data_home else Path.home() / ".local" / "share") / "trifarm" / "farm"


def settings_file(home: Path) -> Path:
    """The settings file of a home folder."""
    return home / "settings.json"


def load_connection(environ: Mapping[str, str], url: str | None = None, token: str | None = None) -> Connection:
    """The connection to use; each environment variable wins over the file on its own.

    The file's token is shown to the file's server alone: it may be that of a farm's administrator.

    Args:
        environ: with TRIFARM_HOME, TRIFARM_URL, TRIFARM_TOKEN and TRIFARM_CA.
        url: wins over both.
        token: wins over both.

    Raises:
        UsageProblem: an address, a token or a file of certificates that cannot be used.
    """
    path = settings_file(home_folder(environ))
    stored = _stored(path)
    url = (url or environ.get("TRIFARM_URL") or stored.get("url") or DEFAULT_URL).strip().rstrip("/")
    server = server_of(url)
    if given := token or environ.get("TRIFARM_TOKEN"):
        token = _usable(given, "TRIFARM_TOKEN" if token is None else "the token that was given")
    elif "token" in stored and server == server_of(stored.get("url", DEFAULT_URL)):
        token = _usable(stored["token"], f"the token in {path}")
    else:
        token = None
    ca = environ.get("TRIFARM_CA") or stored.get("ca")
    if ca is not None and not Path(ca).is_file():
        raise UsageProblem(f"TRIFARM_CA names {ca}, which is no file; it must be a PEM file with the certificates to trust")
    return Connection(url=url, token=token, ca=ca)


def server_of(url: str) -> tuple[str, str, int]:
    """Scheme, host and port of an address.

    Raises:
        UsageProblem: it has none.
    """
    try:
        parts = urlsplit(url)
        port = parts.port or PORTS[parts.scheme]
    except (ValueError, KeyError):
        port = None
    else:
        if parts.hostname:
            return parts.scheme, parts.hostname, port
    raise UsageProblem(f"the server's address is {url!r}; it must begin with http:// or https://, and name a host")


def _usable(token: str, whose: str) -> str | None:
    """A token as it is sent, without the ends of lines that files give it; the text never quotes it."""
    token = token.strip()
    if not all("!" <= letter <= "~" for letter in token):
        raise UsageProblem(
            f"{whose} holds spaces or letters that no token has; copy it again as 'trifarm token create' printed it"
        )
    return token or None


def _stored(path: Path) -> dict[str, str]:
    try:
        stored = json.loads(path.read_text())
    except FileNotFoundError:
        return {}
    except (ValueError, OSError) as error:
        raise UsageProblem(f"cannot read the settings file {path}: {error}; delete it or run 'trifarm up' again") from error
    if not isinstance(stored, dict) or not all(isinstance(stored.get(key, ""), str) for key in ("url", "token", "ca")):
        raise UsageProblem(f'the settings file {path} is not {{"url": …, "token": …}}; delete it or run \'trifarm up\' again')
    return stored


def save_connection(connection: Connection, home: Path) -> Path:
    """Write the settings file, readable by its owner only; whoever reads at the same time sees the old one or the new."""
    home.mkdir(parents=True, exist_ok=True)
    path = settings_file(home)
    temporary = path.with_suffix(f".{os.getpid()}.tmp")
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(descriptor, "w") as file:
        json.dump({name: value for name, value in asdict(connection).items() if name != "ca" or value}, file, indent=2)
    temporary.replace(path)
    return path
