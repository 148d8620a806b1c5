"""The commands of ``trifarm``, a file each; ``client_cli/main.py`` lists them."""
