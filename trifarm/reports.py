"""Reports of jobs as files."""

from pathlib import Path

from api_schemas.report import IdentificationReport, Report, read_report
from client_cli.terminal.errors import UsageProblem

NAME = "report.json"


def report(path: Path | str) -> Report | IdentificationReport:
    """Reads a report, as ``trifarm fetch`` brings it.

    Args:
        path: the JSON file, or the folder with ``report.json``.

    Raises:
        ClientError: there is no such file, or it is no report.

    Example:
        >>> import trifarm
        >>> found = trifarm.report("report.json")
        >>> found.successes <= found.trials
        True
    """
    file = Path(path) / NAME if Path(path).is_dir() else Path(path)
    try:
        return read_report(file.read_bytes())
    except OSError as error:
        raise UsageProblem(f"cannot read {file}: {error.strerror}") from error
    except ValueError as error:
        raise UsageProblem(f"{file} is no report of a job; 'trifarm fetch JOB' brings one as {NAME}") from error
