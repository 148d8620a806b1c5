"""``python -m sim_backend.vision look|video LOG --out FILE``: pictures and films of a trial from its log.

Exit codes: 0 written, 2 the log or what was asked cannot be used, 1 this machine cannot render.
"""

import argparse
import json
import sys
from pathlib import Path

from sim_backend.refusal import ended, refused
from sim_backend.vision.cameras import CamerasMissingError
from sim_backend.vision.film import FilmError, write_film
from sim_backend.vision.pictures import as_file
from sim_backend.vision.views import Views
from trial_logs.reader import LogUnreadableError

EXIT_CANNOT, EXIT_USAGE = 1, 2


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    options = _parser().parse_args(arguments)
    try:
        with Views(options.log, drawn=options.drawn, edges=options.edges) as views:
            said = _look(views, options) if options.command == "look" else _film(views, options)
    except (LogUnreadableError, ValueError, OSError) as error:
        return refused(error, options.json, EXIT_USAGE)
    except (CamerasMissingError, FilmError, ImportError) as error:
        return refused(error, options.json, EXIT_CANNOT)
    print(json.dumps(said) if options.json else _in_words(said))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="trifarm", description="What a robot's three cameras saw in a trial.")
    commands = parser.add_subparsers(dest="command", required=True)
    for name, about in (("look", "write one picture"), ("video", "write a film")):
        command = commands.add_parser(name, help=about)
        command.add_argument("log", type=Path, help="an MCAP file written by a robot of the farm")
        command.add_argument("--out", type=Path, required=True, metavar="FILE", help="where to write it")
        command.add_argument("--drawn", action="store_true", help="draw what was measured, even where the log keeps images")
        command.add_argument("--edges", action="store_true", help="draw the edges of the tracked object")
        command.add_argument("--json", action="store_true", help="print one line of JSON")
        if name == "look":
            command.add_argument("--at", type=float, default=0.0, metavar="SECONDS", help="since the trial's start")
        else:
            command.add_argument("--rate", type=float, default=10.0, metavar="HZ", help="frames a second (default 10)")
    return parser


def _look(views: Views, options: argparse.Namespace) -> dict[str, object]:
    image, exposed_s = views.at(options.at)
    data = as_file(image, options.out.suffix)
    options.out.write_bytes(data)
    return _said(views, options) | {"exposed_s": exposed_s}


def _film(views: Views, options: argparse.Namespace) -> dict[str, object]:
    if not 1.0 <= options.rate <= 100.0:
        raise ValueError(f"the rate is {options.rate:g} Hz; it must be between 1 and 100")
    return _said(views, options) | {"frames": write_film(options.out, views.frames(options.rate), options.rate)}


def _said(views: Views, options: argparse.Namespace) -> dict[str, object]:
    return {"file": str(options.out), "images": "kept" if views.keeps_images else "drawn from what was measured"}


def _in_words(said: dict[str, object]) -> str:
    what = f"{said['frames']} frames" if "frames" in said else f"the views at {said['exposed_s']:.3f} s"
    return f"{said['file']}: {what}, {said['images']}"


if __name__ == "__main__":
    sys.exit(ended(main))
