"""The exit codes of every command, each with the sentence that help and documentation show."""

from enum import IntEnum


class ExitCode(IntEnum):
    """How a command ended."""

    OK = 0
    OTHER = 1
    USAGE = 2
    JOB_WITHOUT_REPORT = 3
    SERVER_AWAY = 4
    REFUSED = 5
    DIFFERS = 6
    WORSE = 7
    UNVERIFIED = 8
    LOGS_MISSING = 9
    OTHER_FORM = 10
    INTERRUPTED = 130


MEANING: dict[ExitCode, str] = {
    ExitCode.OK: "done",
    ExitCode.OTHER: "another error",
    ExitCode.USAGE: "wrong usage or an unusable file",
    ExitCode.JOB_WITHOUT_REPORT: "the job failed or was cancelled",
    ExitCode.SERVER_AWAY: "no server answers",
    ExitCode.REFUSED: "the server refused",
    ExitCode.DIFFERS: "the replay differs from the log, or the report was changed",
    ExitCode.WORSE: "a compared job is worse than the first",
    ExitCode.UNVERIFIED: "the report is signed with an unknown key",
    ExitCode.LOGS_MISSING: "the report is true, but some of its logs are missing",
    ExitCode.OTHER_FORM: "the replay differs from the log, which is of another form of the scene",
    ExitCode.INTERRUPTED: "interrupted by Ctrl-C",
}

OF_EVERY_REQUEST = (ExitCode.OK, ExitCode.OTHER, ExitCode.USAGE, ExitCode.SERVER_AWAY, ExitCode.REFUSED)
"""What any command that asks the server may end with."""


def epilog(*codes: ExitCode) -> str:
    """The last line of a command's help, such as "Exit codes: 0 done; 4 no server answers"."""
    return "Exit codes: " + "; ".join(f"{int(code)} {MEANING[code]}" for code in sorted(codes)) + "."
