"""What workers do in tests; they import it by its name."""

import os
import signal
import time
from pathlib import Path


class Square:
    """Squares a number, plus what all share."""

    def __call__(self, item, shared=None):
        if item == "wrong":
            raise ValueError("not a number")
        return item * item + (shared or 0)


class SlowSquare(Square):
    """The same, half a second later."""

    def __call__(self, item, shared=None):
        time.sleep(0.5)
        return super().__call__(item, shared)


class EndsOnce:
    """Kills its own process at some items, each time that no mark lies in the folder yet; else gives the item back."""

    def __init__(self, folder: str, always: bool = False) -> None:
        self._folder, self._always = Path(folder), always

    def __call__(self, item, shared=None):
        mark = self._folder / str(item)
        if item % 3 == 0 and (self._always or not mark.exists()):
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return item


class Endless:
    """Writes its process's number into the item's file, and never comes to an end."""

    def __call__(self, item, shared=None):
        Path(item).write_text(str(os.getpid()))
        while True:
            pass


class NeverBegins:
    """Kills its own process while it is made."""

    def __init__(self) -> None:
        os.kill(os.getpid(), signal.SIGKILL)


class BeginsEachThirdTime:
    """Kills its own process while it is made, but for each third time; marks in the folder count. Gives items back."""

    def __init__(self, folder: str) -> None:
        number = len(list(Path(folder).iterdir()))
        Path(folder, str(number)).touch()
        if number % 3 != 2:
            os.kill(os.getpid(), signal.SIGKILL)

    def __call__(self, item, shared=None):
        if item == "end":
            os.kill(os.getpid(), signal.SIGKILL)
        return item
