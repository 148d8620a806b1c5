"""The same server on the loopback as for the command line."""

from tests.unit.client_cli.conftest import farm, home, server

__all__ = ["farm", "home", "server"]
