"""``python -m experiments [NAME]``: the program behind ``trifarm experiment``."""

import argparse
import json
import math
import os
import signal
import sys
import tempfile
import time
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from types import FrameType

from sim_backend.refusal import ended, refused

OK, OTHER, USAGE, INTERRUPTED = 0, 1, 2, 130
NEW_FOLDER = "trifarm-experiment-"


def main(arguments: list[str] | None = None) -> int:
    """Run, list or write pages as asked; returns the exit code."""
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    as_json = "--json" in (sys.argv[1:] if arguments is None else arguments)
    if find_spec("torch") is None or find_spec("stable_baselines3") is None:
        said = "experiments need packages that are not installed: pip install -e '.[learning]' in the clone"
        return refused(said, as_json, OTHER)
    from client_cli.terminal.errors import ClientError
    from experiments.farm_trials import WeightsMissingError
    from experiments.result_files import StoreError
    from experiments.trainer import TrainingFailedError
    from sim_backend.folder_lock import TakenError

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # nohup's wish is kept
            signal.signal(number, _interrupt)
    try:
        return _ask(_parser().parse_args(arguments))
    except KeyboardInterrupt:
        _tell("stopped; what is finished is kept, and the same command goes on from there")
        return INTERRUPTED
    except (ClientError, StoreError, WeightsMissingError, TrainingFailedError) as error:
        return refused(error, as_json, OTHER)
    except (_UsageError, TakenError) as error:
        return refused(error, as_json, USAGE)


class _UsageError(Exception):
    """What is asked for does not exist; the message says what does."""


def _ask(options: argparse.Namespace) -> int:
    from experiments.catalogue import CATALOGUE
    from experiments.quick_form import quick_form

    if options.name is not None and options.name not in CATALOGUE:
        raise _UsageError(f"no experiment {options.name!r}; choose from {', '.join(CATALOGUE)}")
    if options.name is None and (not options.list or options.only is not None):
        raise _UsageError(f"say which experiment: {', '.join(CATALOGUE)}; --list shows what is done of each")
    asked = [CATALOGUE[options.name]] if options.name else [*CATALOGUE.values()]
    asked = [quick_form(each) if options.quick else each for each in asked]
    for each in asked:
        _check(options, each)
    with ExitStack() as until_the_end:
        out, work = _folders(options, until_the_end)
        return _list(options, asked, out, work) if options.list else _run(options, asked[0], out, work)


def _folders(options: argparse.Namespace, until_the_end: ExitStack) -> tuple[Path, Path]:
    """Of results and of checkpoints: those of the clone that we run from, wherever the user is; a new one for a quick form."""
    root = Path(__file__).resolve().parents[1]
    root = root if (root / "pyproject.toml").exists() else Path()
    out = options.out or root / "results" / "experiments"
    if options.quick and options.out is None:
        if options.list:  # there is nothing to see yet, and nothing stays
            out = Path(until_the_end.enter_context(tempfile.TemporaryDirectory(prefix=NEW_FOLDER)))
        else:
            out = Path(tempfile.mkdtemp(prefix=NEW_FOLDER))
            _tell(f"results go to a new folder; with --out {out} the same command goes on from them")
    work = options.work or (out / "work" if options.quick else root / "build" / "experiments")
    return out.absolute(), work.absolute()


def _pages(options: argparse.Namespace, out: Path) -> Path | None:
    """Of pages and figures: the clone's where the results are the clone's, else beside the results."""
    return None if options.quick or options.out is not None else out.parents[1] / "docs" / "experiments"


def _run(options: argparse.Namespace, experiment, out: Path, work: Path) -> int:
    from experiments.result_files import StoreError
    from experiments.run import Settings, document, run, write, write_overview
    from experiments.store import Store

    pages = _pages(options, out)
    store = Store(out, work, experiment, pages)
    until_s = math.inf if options.budget_minutes is None else time.monotonic() + 60 * options.budget_minutes
    found = run(experiment, store, Settings(_wanted(options), _jobs(options), lambda: time.monotonic() < until_s, _tell))
    written = write(found, store)
    if not options.quick:
        try:
            written.append(write_overview(out, work, pages))
        except StoreError as error:
            _tell(f"the page of all experiments stays as it was: {error}")
    for path in written:
        _tell(f"wrote {path}")
    if options.json:
        print(json.dumps(document(found) | {"folder": str(out)}, indent=2))
    else:
        print("\n".join(_told(found)))
    return OK


def _wanted(options: argparse.Namespace):
    from experiments.plan import Wanted

    return Wanted(options.only, options.seed)


def _jobs(options: argparse.Namespace) -> int:
    from experiments.trainer import cores

    return options.jobs or min(2, cores())


def _check(options: argparse.Namespace, experiment) -> None:
    """Raises _UsageError for a cell or seed that the experiment does not have."""
    seeds = {seed for cell in experiment.cells for seed in cell.seeds}
    if options.only is not None:
        try:
            seeds = set(experiment.cell(options.only).seeds)
        except ValueError as error:
            raise _UsageError(str(error)) from error
    if options.name is not None and options.seed is not None and options.seed not in seeds:
        raise _UsageError(f"there is no seed {options.seed} here; choose from {', '.join(map(str, sorted(seeds)))}")


def _list(options: argparse.Namespace, asked: list, out: Path, work: Path) -> int:
    from experiments.result_files import StoreError
    from experiments.store import Store

    _tell(f"results in {out}, checkpoints in {work}")
    documents = []
    for experiment in asked:
        try:
            documents.append(_listed(options, experiment, Store(out, work, experiment)))
        except StoreError as error:
            if options.name is not None:
                raise
            documents.append({"experiment": experiment.name, "quick": experiment.quick, "refused": str(error)})
    if options.json:
        print(json.dumps({"experiments": documents} if options.name is None else documents[0], indent=2))
    elif options.name is None:
        print("\n".join(_in_a_line(each) for each in documents))
    else:
        for piece in documents[0]["pieces"]:
            print(f"{'done   ' if piece['done'] else 'missing'}  {piece['seconds'] / 60:7.1f} min  {piece['piece']}")
        print(_in_a_line(documents[0]))
    return OK


def _listed(options: argparse.Namespace, experiment, store) -> dict:
    from experiments.plan import hours
    from experiments.run import listed

    found = listed(experiment, store, _wanted(options))
    rows = [{"piece": piece.name, "done": done, "seconds": round(piece.seconds, 1)} for piece, done in found]
    left_h = hours([piece for piece, done in found if not done], _jobs(options))
    return {"experiment": experiment.name, "quick": experiment.quick, "pieces": rows, "hours_left": left_h}


def _in_a_line(listed: dict) -> str:
    from experiments.plan import spoken

    if "refused" in listed:
        return f"{listed['experiment']}: {listed['refused']}"
    done, pieces = sum(piece["done"] for piece in listed["pieces"]), len(listed["pieces"])
    left = f"; what is missing takes about {spoken(listed['hours_left'])}" if done < pieces else ""
    return f"{listed['experiment']}: {done} of {pieces} pieces of work are done{left}"


def _told(found) -> list[str]:
    from experiments.page import shown

    lines = [f"({found.experiment.letter}) {found.experiment.title}: {found.state}"]
    for each in found.judged:
        said = "" if each.found is None else f", {shown(each.contrast, each.found)}"
        lines.append(f"  {each.contrast.name}: {each.verdict}{said}")
    return lines


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="trifarm experiment", description="Try a paper's claim on a farm of our own.")
    parser.add_argument("name", nargs="?")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--only")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--budget-minutes", type=float)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--work", type=Path)
    parser.add_argument("--json", action="store_true")
    return parser


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(ended(main))
