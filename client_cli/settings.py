"""Where the server is and who asks: TRIFARM_URL, _TOKEN and _CA, else the settings file that ``trifarm up`` wrote."""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import typer

from client_cli.errors import UsageProblem

DEFAULT_PORT = 8787
DEFAULT_URL = f"http://127.0.0.1:{DEFAULT_PORT}"


@dataclass(frozen=True)
class Connection:
    """Address of the server and the bearer token to show it; without a token only /healthz answers.

    ``ca`` is a PEM file with the certificates that vouch for the server's, instead of those that this machine trusts.
    """

    url: str
    token: str | None
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


def load_connection(environ: Mapping[str, str]) -> Connection:
    """The connection to use; each environment variable wins over the file on its own."""
    stored = _stored(settings_file(home_folder(environ)))
    url = environ.get("TRIFARM_URL") or stored.get("url") or DEFAULT_URL
    if not url.startswith(("http://", "https://")):
        raise UsageProblem(f"the server's address is {url!r}; it must begin with http:// or https://")
    token, ca = environ.get("TRIFARM_TOKEN") or stored.get("token"), environ.get("TRIFARM_CA") or stored.get("ca")
    if ca is not None and not Path(ca).is_file():
        raise UsageProblem(f"TRIFARM_CA names {ca}, which is no file; it must be a PEM file with the certificates to trust")
    return Connection(url=url.rstrip("/"), token=token, ca=ca)


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
