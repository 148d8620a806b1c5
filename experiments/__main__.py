"""``python -m experiments NAME``: the program behind ``trifarm experiment``."""

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from types import FrameType

OK, OTHER, USAGE, INTERRUPTED = 0, 1, 2, 130


def main(arguments: list[str] | None = None) -> int:
    """Run, list or write pages as asked; returns the exit code."""
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    if find_spec("torch") is None or find_spec("stable_baselines3") is None:
        return _problem("experiments need packages that are not installed: pip install 'trifarm[learning]'", OTHER)
    from client_cli.errors import ClientError
    from experiments.farm_trials import WeightsMissingError
    from experiments.store import StoreError
    from experiments.trainer import TrainingFailedError

    signal.signal(signal.SIGTERM, _interrupt)
    try:
        return _ask(_parser().parse_args(arguments))
    except KeyboardInterrupt:
        return _problem("stopped; what is finished is kept, and the same command goes on from there", INTERRUPTED)
    except (ClientError, StoreError, WeightsMissingError, TrainingFailedError) as error:
        return _problem(str(error), OTHER)
    except _UsageError as error:
        return _problem(str(error), USAGE)


class _UsageError(Exception):
    """What is asked for does not exist; the message says what does."""


def _ask(options: argparse.Namespace) -> int:
    from experiments.catalogue import CATALOGUE
    from experiments.design import quick
    from experiments.plan import Wanted
    from experiments.run import Settings, document, run, write, write_overview
    from experiments.store import Store
    from experiments.trainer import cores

    if options.name not in CATALOGUE:
        raise _UsageError(f"no experiment {options.name!r}; choose from {', '.join(CATALOGUE)}")
    experiment = quick(CATALOGUE[options.name]) if options.quick else CATALOGUE[options.name]
    _check(options, experiment)
    out = options.out or (Path(tempfile.mkdtemp(prefix="trifarm-experiment-")) if options.quick else Path("docs/experiments"))
    store = Store(out, options.work or (out / "work" if options.quick else Path("build/experiments")), experiment)
    jobs = options.jobs or min(2, cores())
    if options.list:
        return _list(experiment, store, jobs, as_json=options.json)
    until_s = None if options.budget_minutes is None else time.monotonic() + 60 * options.budget_minutes
    settings = Settings(Wanted(options.only, options.seed), jobs, lambda: until_s is None or time.monotonic() < until_s, _tell)
    found = run(experiment, store, settings)
    written = [*write(found, store), *([] if options.quick else [write_overview(out, store.work)])]
    for path in written:
        _tell(f"wrote {path}")
    if options.json:
        print(json.dumps(document(found) | {"folder": str(out)}, indent=2))
    else:
        print("\n".join(_told(found)))
    return OK


def _check(options: argparse.Namespace, experiment) -> None:
    """Raises _UsageError for a cell or seed that the experiment does not have."""
    seeds = {seed for cell in experiment.cells for seed in cell.seeds}
    if options.only is not None:
        try:
            seeds = set(experiment.cell(options.only).seeds)
        except ValueError as error:
            raise _UsageError(str(error)) from error
    if options.seed is not None and options.seed not in seeds:
        raise _UsageError(f"there is no seed {options.seed} here; choose from {', '.join(map(str, sorted(seeds)))}")


def _list(experiment, store, jobs: int, *, as_json: bool) -> int:
    from experiments.plan import hours
    from experiments.run import listed

    all_of_it = listed(experiment, store)
    left_h = hours([piece for piece, done in all_of_it if not done], jobs)
    if as_json:
        rows = [{"piece": piece.name, "done": done, "seconds": round(piece.seconds, 1)} for piece, done in all_of_it]
        print(
            json.dumps({"experiment": experiment.name, "quick": experiment.quick, "pieces": rows, "hours_left": left_h}, indent=2)
        )
        return OK
    for piece, done in all_of_it:
        print(f"{'done   ' if done else 'missing'}  {piece.seconds / 60:7.1f} min  {piece.name}")
    print(f"{sum(done for _, done in all_of_it)} of {len(all_of_it)} done; what is missing takes about {left_h:.1f} hours")
    return OK


def _told(found) -> list[str]:
    from experiments.page import shown

    lines = [f"({found.experiment.letter}) {found.experiment.title}: {found.state}"]
    for each in found.judged:
        said = "" if each.found is None else f", {shown(each.contrast, each.found)}"
        lines.append(f"  {each.contrast.name}: {each.verdict}{said}")
    return lines


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="trifarm experiment", description="Try a paper's claim on a farm of our own.")
    parser.add_argument("name")
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


def _problem(sentence: str, code: int) -> int:
    _tell(f"error: {sentence}")
    return code


if __name__ == "__main__":
    sys.exit(main())
