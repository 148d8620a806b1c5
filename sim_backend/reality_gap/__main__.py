"""The reality gap as commands: ``python -m sim_backend.reality_gap study|replay|blind-test|excite``; ``trifarm gap`` starts them.

Exit codes: 0 a verdict was reached, whichever; 2 usage, or data that cannot be used; 130 stopped by the user.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # before numpy is imported: threads of small matrices only wait
    os.environ.setdefault(name, "1")

from sim_backend.reality_gap.recording import RecordingError  # noqa: E402
from sim_backend.refusal import ended, refused  # noqa: E402

EXIT_INTERRUPTED = 130
_QUIET_S = 1.0


def main(arguments: list[str] | None = None) -> int:
    """Run one of the commands."""
    given = sys.argv[1:] if arguments is None else arguments
    if given[:1] == ["blind-test"]:
        from sim_backend.reality_gap.bench import joints

        return joints.main(given[1:])
    if given[:1] == ["excite"]:
        from sim_backend.reality_gap.advice import answer

        return answer.main(given[1:])
    return _study(given)


def _replay(options: argparse.Namespace) -> int:
    from sim_backend.reality_gap.replay import replay

    try:
        for path in (options.extended, options.source, *options.model):
            if not path.exists():
                raise RecordingError(f"there is no {path}")
        if options.window < 0.0:
            raise RecordingError("--window is a time in seconds; without it recordings are replayed as a whole")
        settings = {"data_root": options.data, "others": options.model, "window_s": options.window}
        found = replay(options.extended, options.source, **settings, progress=_Progress())
    except RecordingError as error:
        return refused(error, options.json)
    print(json.dumps(found.document()) if options.json else "\n".join(found.lines()))
    return 0


def _study(given: list[str]) -> int:
    from sim_backend.reality_gap.subjects.joints.torques.calibrating import METHODS

    parser = argparse.ArgumentParser(prog="trifarm gap", description="Compare measured data with the simulation.")
    commands = parser.add_subparsers(dest="command", required=True)
    study = commands.add_parser("study", help="what the simulation gets wrong, and why")
    study.add_argument("source", type=Path, metavar="STUDY.toml|LOGDIR", help="a study file, or a folder of the farm's logs")
    study.add_argument("--data", type=Path, metavar="DIR", help="where a study file's data lie")
    study.add_argument("--out", type=Path, metavar="DIR", help="where results go (gap-NAME)")
    study.add_argument("--method", choices=METHODS, default=METHODS[0], help="how to fit (%(default)s)")
    study.add_argument("--seed", type=int, default=0, help="of resampling and splits (%(default)s)")
    study.add_argument("--trials", type=Path, metavar="JOBDIR", help="trials of a policy on the same robot, as fetched")
    study.add_argument("--policy", type=Path, metavar="FILE", help="that policy: success is predicted with both models")
    study.add_argument("--manifest", metavar="LAYOUT|FILE", help="what it expects: a ready-made layout or a file")
    study.add_argument("--json", action="store_true", help="print the verdict as one JSON document")
    again = commands.add_parser("replay", help="how far an extended model goes from where a robot went")
    again.add_argument("extended", type=Path, metavar="DIR|MJCF", help="results of a study, or a model")
    again.add_argument("source", type=Path, metavar="STUDY.toml", help="the recordings")
    again.add_argument("--data", type=Path, metavar="DIR", help="where a study file's data lie")
    again.add_argument("--model", type=Path, action="append", default=[], metavar="MJCF", help="another model to replay, too")
    again.add_argument("--window", type=float, default=0.0, metavar="SECONDS", help="begin anew where the robot was")
    again.add_argument("--json", action="store_true", help="print one JSON document")
    for name, what in (("blind-test", "hide effects in simulated robots and ask for them"), ("excite", "what to record next")):
        commands.add_parser(name, help=what)
    options = parser.parse_args(given)
    if options.command == "replay":
        return _replay(options)
    asked = (options.trials, options.policy, options.manifest)
    if any(asked) and not all(asked):
        parser.error("--trials, --policy and --manifest go together")
    return _run(options)


def _run(options: argparse.Namespace) -> int:
    from sim_backend.reality_gap.report.report import summary_lines
    from sim_backend.reality_gap.study import run_study
    from sim_backend.reality_gap.success.prediction import Trials

    out = options.out if options.out is not None else Path(f"gap-{options.source.stem or 'study'}")
    try:
        if not options.source.exists():
            raise RecordingError(f"there is no {options.source}: give a study.toml or a folder of logs")
        trials = Trials(options.trials, options.policy, options.manifest) if options.trials is not None else None
        settings = {"data_root": options.data, "method": options.method, "seed": options.seed}
        result = run_study(options.source, out, **settings, trials=trials, progress=_Progress())
    except RecordingError as error:
        return refused(error, options.json)
    if options.json:
        success = {name: result.document[name] for name in ("success",) if name in result.document}
        print(json.dumps(result.document["verdict"] | success | {"files": [str(path) for path in result.files]}))
        return 0
    for line in summary_lines(result.document):
        print(line)
    print(f"Report: {out / 'report.html'}")
    return 0


class _Progress:
    """Tells on stderr what is done, with an estimate of the time left, not more than once a second."""

    def __init__(self) -> None:
        self._begun, self._told = time.monotonic(), 0.0

    def __call__(self, what: str, share: float) -> None:
        now = time.monotonic()
        if now - self._told < _QUIET_S:
            return
        self._told = now
        spent = now - self._begun
        left = f", about {spent / share * (1 - share):.0f} s left" if share > 0.1 else ""
        print(f"{share:4.0%} {what}{left}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    try:
        sys.exit(ended(main))
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)
