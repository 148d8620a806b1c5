"""Make cases, ask the tool about them, count its answers: ``python -m tests.second_generator make|judge|score``."""

import argparse
import json
import sys
from pathlib import Path

from tests.second_generator.seeds import FINAL_COUNTS, FINAL_SEEDS, KINDS


def main(arguments=None):
    """The command line; gives the exit code: 0 done, 2 refused."""
    asked = _parser().parse_args(arguments)
    return {"make": make, "judge": judge, "score": score}[asked.command](asked)


def make(asked):
    """Write cases of one kind; those that are there stay."""
    from tests.second_generator.case import draw_case
    from tests.second_generator.folder import is_made, write_case

    if asked.seed in FINAL_SEEDS and not asked.final_run:
        print(f"seed {asked.seed} is sealed for the final run: take a development seed, or add --final-run", file=sys.stderr)
        return 2
    count = FINAL_COUNTS[asked.kind] if asked.count is None else asked.count
    for index in range(asked.first, asked.first + count):
        if not is_made(asked.to, asked.seed, asked.kind, index):
            print(write_case(draw_case(asked.seed, asked.kind, index), asked.to), flush=True)
    return 0


def judge(asked):
    """Ask the installed tool about every case of a folder."""
    from tests.second_generator.judging import judge as judge_all

    judge_all(asked.folder, asked.out, limit_s=asked.limit_s, say=lambda line: print(line, flush=True), method=asked.method)
    return 0


def score(asked):
    """Count the answers and print tables, or one JSON document."""
    from tests.second_generator import scoring

    rows = [json.loads(line) for line in asked.results.read_text().splitlines() if line]
    counts = scoring.score(rows, scoring.read_truths(asked.truth))
    print(json.dumps(counts, indent=1) if asked.json else scoring.text_of(counts))
    return 0


def _parser():
    parser = argparse.ArgumentParser(prog="python -m tests.second_generator", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("make", help="write cases")
    one.add_argument("--seed", type=int, required=True, help="development seeds stand in seeds.py")
    one.add_argument("--kind", choices=KINDS, required=True)
    one.add_argument("--count", type=int, help="number of cases; without it that of the final run")
    one.add_argument("--first", type=int, default=0, help="index of the first case")
    one.add_argument("--to", type=Path, required=True, help="folder that gets cases/ and truth/")
    one.add_argument("--final-run", action="store_true", help="open a sealed seed: only for the run that counts")
    two = commands.add_parser("judge", help="ask trifarm gap study about each case that has no answer yet")
    two.add_argument("folder", type=Path)
    two.add_argument("--out", type=Path, required=True, help="file that gets one line of JSON for each case")
    two.add_argument("--limit-s", type=float, default=3600.0, help="longest time for one study, s")
    two.add_argument("--method", help="of the study; without it the tool's own, as users ask")
    three = commands.add_parser("score", help="count the answers")
    three.add_argument("results", type=Path)
    three.add_argument("truth", type=Path)
    three.add_argument("--json", action="store_true")
    return parser


if __name__ == "__main__":
    sys.exit(main())
