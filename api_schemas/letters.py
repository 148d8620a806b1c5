"""Many policies at once: who can be told from whom, with the chance of any false pair kept, told by letters."""

from collections.abc import Callable, Sequence

from api_schemas.anytime import CHANCE

MOST_GROUPS = 81
"""As many as twelve policies can fall into (3 ** 4; Moon and Moser, Israel J. Math. 3 (1965) 23). With every three more it can be
three times as many: nobody reads such letters, and who makes them has time for nothing else."""


def pair_chance(policies: int) -> float:
    """The chance of an error that each pair of so many policies may have, if all pairs together are to have ``CHANCE``.

    Bonferroni's bound; it holds whatever the pairs have in common, and at every look.
    """
    return CHANCE / max(1, policies * (policies - 1) // 2)


def holm(chances: Sequence[float]) -> list[bool]:
    """Which hypotheses are refuted by their p, with ``CHANCE`` of any false one (Holm, Scand. J. Stat. 6 (1979) 65)."""
    refuted, left = [False] * len(chances), len(chances)
    for index in sorted(range(len(chances)), key=lambda each: chances[each]):
        if chances[index] > CHANCE / left:
            break
        refuted[index], left = True, left - 1
    return refuted


def compact_letters(apart: Sequence[Sequence[bool]]) -> tuple[str | None, ...]:
    """Letters for policies in their order, best first: two that share one cannot be told apart.

    Insert and absorb (Piepho, J. Comput. Graph. Stat. 13 (2004) 456): each pair that differs splits the groups that hold both. Of
    policies in more than ``MOST_GROUPS`` groups none gets letters.

    Args:
        apart: whether the policies of a row and of a column were told apart; symmetric.
    """
    count = len(apart)
    groups = [frozenset(range(count))]
    for one in range(count):
        for other in range(one):
            if not apart[one][other]:
                continue
            split = [part for group in groups for part in _without(group, one, other)]
            groups = [group for group in dict.fromkeys(split) if not any(group < larger for larger in split)]
            if len(groups) > MOST_GROUPS:
                return (None,) * count
    ordered = sorted(groups, key=sorted)
    return tuple("".join(_letter(index) for index, group in enumerate(ordered) if each in group) for each in range(count))


def _without(group: frozenset[int], one: int, other: int) -> tuple[frozenset[int], ...]:
    return (group - {one}, group - {other}) if one in group and other in group else (group,)


def _letter(index: int) -> str:
    """Of the alphabet, then once more with a dash."""
    return chr(ord("a") + index % 26) + "'" * (index // 26)


def letters_where(count: int, differ: Callable[[int, int], bool]) -> tuple[str | None, ...]:
    """Letters of so many policies in their order, best first; ``differ`` says of two of them whether they were told apart."""
    apart = [[False] * count for _ in range(count)]
    for one in range(count):
        for other in range(one):
            apart[one][other] = apart[other][one] = differ(one, other)
    return compact_letters(apart)
