"""The public Python API of trifarm: submit policies, read logs, train, study measured data.

Everything in ``__all__`` is loaded when it is first used, so that ``import trifarm`` costs nothing. Whatever else is in this
repository may move.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from api_schemas.policy import PolicyCheck
    from api_schemas.report import Report
    from client_cli.terminal.errors import ClientError
    from sim_backend.effects.physics import Physics
    from sim_backend.environments.gym_env import TrifingerEnv
    from sim_backend.environments.practice import practice_of
    from sim_backend.environments.vec_env import TrifingerVecEnv
    from sim_backend.reality_gap.recording import RecordingError
    from sim_backend.reality_gap.study import StudyResult
    from trial_logs.reader import LogUnreadableError
    from trifarm.callbacks import evaluate_runner
    from trifarm.evaluation import Evaluation, evaluate
    from trifarm.farm import Farm, FarmJob, FarmTrial
    from trifarm.gap import study
    from trifarm.log import Log, read_log
    from trifarm.policies import Packed, check, pack
    from trifarm.reports import report
    from trifarm.saving import save_policy
    from trifarm.stable_baselines import EvaluateOnFarm

__all__ = [
    "ClientError",
    "EvaluateOnFarm",
    "Evaluation",
    "Farm",
    "FarmJob",
    "FarmTrial",
    "Log",
    "LogUnreadableError",
    "Packed",
    "Physics",
    "PolicyCheck",
    "RecordingError",
    "Report",
    "StudyResult",
    "TrifingerEnv",
    "TrifingerVecEnv",
    "check",
    "evaluate",
    "evaluate_runner",
    "pack",
    "practice_of",
    "read_log",
    "report",
    "save_policy",
    "study",
]

_HOMES = {
    "ClientError": "client_cli.terminal.errors",
    "EvaluateOnFarm": "trifarm.stable_baselines",
    "Evaluation": "trifarm.evaluation",
    "Farm": "trifarm.farm",
    "FarmJob": "trifarm.farm",
    "FarmTrial": "trifarm.farm",
    "Log": "trifarm.log",
    "LogUnreadableError": "trial_logs.reader",
    "Packed": "trifarm.policies",
    "Physics": "sim_backend.effects.physics",
    "PolicyCheck": "api_schemas.policy",
    "RecordingError": "sim_backend.reality_gap.recording",
    "Report": "api_schemas.report",
    "StudyResult": "sim_backend.reality_gap.study",
    "TrifingerEnv": "sim_backend.environments.gym_env",
    "TrifingerVecEnv": "sim_backend.environments.vec_env",
    "check": "trifarm.policies",
    "evaluate": "trifarm.evaluation",
    "evaluate_runner": "trifarm.callbacks",
    "pack": "trifarm.policies",
    "practice_of": "sim_backend.environments.practice",
    "read_log": "trifarm.log",
    "report": "trifarm.reports",
    "save_policy": "trifarm.saving",
    "study": "trifarm.gap",
}
_OF_AN_EXTRA = {"gymnasium", "stable_baselines3", "torch"}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'trifarm' has no attribute {name!r}; it has {', '.join(__all__)}")
    try:
        found = getattr(import_module(_HOMES[name]), name)
    except ModuleNotFoundError as error:
        if error.name not in _OF_AN_EXTRA:
            raise
        from sim_backend.extras import how_to_install

        raise ImportError(f"trifarm.{name} needs {error.name}: {how_to_install('learning')}", name=error.name) from error
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return __all__
