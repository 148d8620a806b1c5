"""How the commands of the reality gap say that what they were given cannot be used."""

import json
import sys

from api_schemas.error import error_document

EXIT_UNUSABLE = 2


def refused(error: Exception, as_json: bool) -> int:
    """Say it in a line on stderr and, if JSON was asked for, in the one document on stdout; gives the exit code."""
    said = f"cannot use {error.filename}: {error.strerror}" if isinstance(error, OSError) and error.filename else str(error)
    if as_json:
        print(json.dumps(error_document("wrong usage", said, EXIT_UNUSABLE)))
    print(f"error: {said}", file=sys.stderr)
    return EXIT_UNUSABLE
