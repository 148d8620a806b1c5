"""``python -m client_cli`` is the command ``trifarm``."""

from client_cli.entry import main

main()
