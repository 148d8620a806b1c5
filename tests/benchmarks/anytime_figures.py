"""How often the statistics of questions err when one looks after each goal, and how soon they decide.

    python -m tests.benchmarks.anytime_figures --out results/anytime.json

Null pairs are two policies of one success rate that try the same goals independently. The table has exact means of the
sequential test beside McNemar's exact test of a fixed size, both with the same power; null is what would need more goals than
were tried. Ten equal policies are compared pair by pair after each goal, with the chance of an error shared by all pairs.
"""

import argparse
import json
import math
from pathlib import Path

import numpy as np

from api_schemas.anytime import CHANCE, rate_sequence
from api_schemas.letters import pair_chance
from services.jobs.power import MOST_GOALS, decided_within, needed_gains, needed_gains_at

RATES = (0.05, 0.5, 0.9)
SHARES = tuple((lost, gained) for lost in (0.05, 0.10, 0.20) for gained in (0.25, 0.35, 0.55) if gained > lost)
POWER = 0.90
AT_ONCE = 1000


def false_decisions(rate, runs, goals, rng):
    """Of pairs of equal policies, how many are ever decided."""
    needed, wrong = needed_gains()[: goals + 1], 0
    for _ in range(0, runs, AT_ONCE):
        wrong += int(_ever_decided(rng.random((2, AT_ONCE, goals)) < rate, needed).sum())
    return wrong


def _ever_decided(succeeded, needed):
    """Which pairs are decided at any goal; shape (2, runs, goals) in, (runs,) out."""
    gained = np.cumsum(succeeded[1] & ~succeeded[0], axis=1)
    lost = np.cumsum(succeeded[0] & ~succeeded[1], axis=1)
    return (np.maximum(gained, lost) >= needed[gained + lost]).any(axis=1)


def edges(rate, trials, level):
    """The fewest and the most successes with which the sequence holds the rate after each number of trials."""
    fewest, most = [0], [0]
    for number in range(1, trials + 1):
        low, high = fewest[-1], most[-1]
        while rate_sequence(low, number, level)[1] < rate:
            low += 1
        while high < number and rate_sequence(high + 1, number, level)[0] <= rate:
            high += 1
        fewest.append(low)
        most.append(high)
    return np.array(fewest[1:]), np.array(most[1:])


def held(rate, runs, trials, level, rng):
    """In how many runs the rate is within the sequence after every trial."""
    fewest, most = edges(rate, trials, level)
    kept = 0
    for _ in range(0, runs, AT_ONCE):
        successes = np.cumsum(rng.random((AT_ONCE, trials)) < rate, axis=1)
        kept += int(((successes >= fewest) & (successes <= most)).all(axis=1).sum())
    return kept


def equal_policies(policies, runs, goals, rate, rng):
    """In how many runs any pair of so many equal policies is ever told apart."""
    needed, wrong = needed_gains_at(pair_chance(policies))[: goals + 1], 0
    pairs = [(one, other) for one in range(policies) for other in range(one)]
    at_once = 100
    for _ in range(0, runs, at_once):
        succeeded = rng.random((policies, at_once, goals)) < rate
        apart = [_ever_decided(succeeded[list(pair)], needed) for pair in pairs]
        wrong += int(np.any(apart, axis=0).sum())
    return wrong


def mcnemar_power(goals, lost, gained):
    """Power of McNemar's exact two-sided test at ``CHANCE`` with a fixed number of goals."""
    differing, share, power = lost + gained, gained / (lost + gained), 0.0
    for number in range(goals + 1):
        weight = math.comb(goals, number) * differing**number * (1 - differing) ** (goals - number)
        tails, most = 0.0, -1
        while most + 1 <= number and 2 * (tails + math.comb(number, most + 1) / 2**number) <= CHANCE:
            most += 1
            tails += math.comb(number, most) / 2**number
        few = sum(math.comb(number, k) * (share**k * (1 - share) ** (number - k)) for k in range(most + 1))
        many = sum(math.comb(number, k) * (share ** (number - k) * (1 - share) ** k) for k in range(most + 1))
        power += weight * (few + many)
    return power


def smallest(enough, most=MOST_GOALS):
    """The smallest whole number that is enough, for what is enough from there on; None if ``most`` is not."""
    if not enough(most):
        return None
    low, high = 1, most
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle + 1, high)
    return low


def row(lost, gained):
    """One row of the table."""
    fixed = smallest(lambda goals: mcnemar_power(goals, lost, gained) >= POWER, 400)
    budget = smallest(lambda goals: decided_within(goals, lost, gained)[0] >= POWER)
    return {
        "lost": lost,
        "gained": gained,
        "mcnemar_goals": fixed,
        "budget": budget,
        "mean_goals_within_budget": budget and round(decided_within(budget, lost, gained)[1], 1),
        "mean_goals_until_decided": round(decided_within(MOST_GOALS, lost, gained)[1], 1),
    }


def main():
    parser = argparse.ArgumentParser(description="Figures of the statistics that hold at every look.")
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--goals", type=int, default=1000)
    parser.add_argument("--families", type=int, default=2000)
    parser.add_argument("--rows", type=int, default=len(SHARES), help="of the table")
    parser.add_argument("--seed", type=int, default=24)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    rates = [
        {
            "rate": rate,
            "false_decisions": false_decisions(rate, given.runs, given.goals, rng),
            "held_95": held(rate, given.runs, given.goals, 0.95, rng),
            "held_80": held(rate, given.runs, given.goals, 0.80, rng),
            "false_families": equal_policies(10, given.families, given.goals, rate, rng),
        }
        for rate in RATES
    ]
    table = [row(*shares) for shares in SHARES[: given.rows]]
    asked = {"runs": given.runs, "goals": given.goals, "families": given.families, "seed": given.seed, "chance": CHANCE}
    found = {"asked": asked, "power": POWER, "rates": rates, "table": table}
    text = json.dumps(found, indent=1) + "\n"
    print(text, end="")
    if given.out is not None:
        given.out.write_text(text)


if __name__ == "__main__":
    main()
