"""Shows a job's progress on stderr: a live bar on a terminal, lines in a file or a pipe."""

from types import TracebackType
from typing import Protocol, Self

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Column

from client_cli.terminal.output import note, stderr_console
from client_cli.views.progress import JobProgress, sentence

BAR_WIDTH, NUMBERS_WIDTH = 16, 7
"""Also where the sentence beside them is long: that goes on in a second line."""
MOST_ROBOTS = 16
"""That get a bar of their own."""
LINE_EVERY = 0.05
"""Without a terminal, a line is printed for each such share of the trials."""


class ProgressView(Protocol):
    """Something that shows progress while a job runs."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /) -> None: ...

    def show(self, progress: JobProgress) -> None:
        """Show where the job is now."""
        ...

    def say(self, text: str) -> None:
        """A line of its own, such as a lost connection."""
        ...


class ProgressBar:
    """A live bar for a terminal, and below it one for each robot: of its trials, those that succeeded."""

    def __init__(self) -> None:
        columns = (
            BarColumn(BAR_WIDTH, table_column=Column(min_width=BAR_WIDTH)),
            MofNCompleteColumn(table_column=Column(min_width=NUMBERS_WIDTH)),
            TimeElapsedColumn(table_column=Column(min_width=NUMBERS_WIDTH)),
            TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=False)),
        )
        self._bar = Progress(*columns, console=stderr_console(), refresh_per_second=4)
        self._row = self._bar.add_task("", total=None)
        self._rows: dict[str, TaskID] = {}

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def show(self, progress: JobProgress) -> None:
        """Move the bar."""
        self._bar.update(self._row, completed=progress.done, total=progress.trials, description=sentence(progress))
        if not progress.has_goals:
            return
        for robot, done, successes in progress.of_robots[:MOST_ROBOTS]:
            if robot not in self._rows:
                self._rows[robot] = self._bar.add_task(robot, total=None)
            words = f"{robot}: {successes} of {done} succeeded"
            self._bar.update(self._rows[robot], completed=successes, total=done, description=words)

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        self._bar.console.print(text)


class ProgressLines:
    """Lines for a file or a pipe: one for every twentieth of the trials, and one for each new reason to wait."""

    def __init__(self) -> None:
        self._shown = 0
        self._reason: str | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def show(self, progress: JobProgress) -> None:
        """Print a line if there is something new to say."""
        has_moved = progress.done - self._shown >= max(1, LINE_EVERY * progress.trials)
        has_ended = progress.done == progress.trials != self._shown
        waits_anew = progress.waiting_because not in {None, self._reason}
        if has_moved or has_ended or waits_anew:
            self._shown, self._reason = progress.done, progress.waiting_because
            note(f"{progress.done}/{progress.trials} done, {sentence(progress)}")

    def say(self, text: str) -> None:
        """Print a line."""
        note(text)


def progress_view() -> ProgressView:
    """A bar if stderr is a terminal, lines otherwise."""
    return ProgressBar() if stderr_console().is_terminal else ProgressLines()
