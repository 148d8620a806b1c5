"""Files of foreign data by their format."""

from pathlib import Path

from sim_backend.reality_gap.measured.foreign.array_table import open_npz, open_parquet
from sim_backend.reality_gap.measured.foreign.csv_table import open_csv
from sim_backend.reality_gap.measured.foreign.data_table import DataTable
from sim_backend.reality_gap.recording import RecordingError

SUFFIXES = (".csv", ".csv.gz", ".parquet", ".npz")


def open_table(path: Path) -> DataTable:
    """The file as a table of columns.

    Raises:
        RecordingError: an unknown format, or a file that is missing, empty or broken.
    """
    if not path.is_file():
        raise RecordingError(f"{path}: there is no such file")
    name = path.name.lower()
    if name.endswith(".parquet"):
        return open_parquet(path)
    if name.endswith(".npz"):
        return open_npz(path)
    if name.endswith((".csv", ".csv.gz")):
        return open_csv(path)
    raise RecordingError(f"{path}: unknown format; readable are {', '.join(SUFFIXES)}")
