"""Messages of the command line as a program's user reads them: with the names of arguments in place of options."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from client_cli.terminal.errors import ClientError

_OPTION = re.compile(r"('trifarm [^']*')|(?<![\w./-])--([a-z][a-z-]*)")
"""An option, or a whole command in quotes, whose options are its own."""


def of_python(detail: str, arguments: Mapping[str, str]) -> str:
    """A message with arguments in place of options; ``arguments`` are those that are called otherwise than their option."""

    def named(found: re.Match[str]) -> str:
        return found[1] or arguments.get(found[2], found[2].replace("-", "_"))

    return _OPTION.sub(named, detail)


@contextmanager
def worded(arguments: Mapping[str, str]) -> Iterator[None]:
    """A ClientError from inside names arguments; it stays the error that it was."""
    try:
        yield
    except ClientError as error:
        error.detail = of_python(error.detail, arguments)
        error.args = (error.detail,)
        raise
