"""How the commands of the reality gap say that what they were given cannot be used."""

import json
import sys

from api_schemas.command_error import error_document

EXIT_UNUSABLE = 2


def refused(error: Exception, as_json: bool) -> int:
    """Say it in a line on stderr and, if JSON was asked for, in the one document on stdout; gives the exit code."""
    if as_json:
        print(json.dumps(error_document("wrong usage", str(error), EXIT_UNUSABLE)))
    print(f"error: {error}", file=sys.stderr)
    return EXIT_UNUSABLE
