"""How pressing a job is, as the database counts it: trials of a smaller rank go first, users take turns within a rank.

Everybody may wait behind the rest (low); nobody but an operator may go before it (high), so that no user overtakes another.
"""

from api_schemas.job import JobPriority
from services.database.tables import NORMAL_RANK

RANKS = {JobPriority.HIGH: 0, JobPriority.NORMAL: NORMAL_RANK, JobPriority.LOW: 2}
_NAMES = {rank: name for name, rank in RANKS.items()}


def priority_of(rank: int) -> JobPriority:
    """The name of a rank."""
    return _NAMES[rank]
