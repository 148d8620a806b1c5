"""``trifarm effects``: the catalogue of what can be different about a robot."""

from client_cli.child_answer import answer_of, pass_on
from client_cli.child_process import module_command
from client_cli.options import JsonOption


def effects(as_json: JsonOption = False) -> None:
    """List every effect a robot may have, with the bounds, units and sources of its parameters."""
    flags = ["--json"] if as_json else []
    pass_on("effects", answer_of(module_command("sim_backend.effects", *flags)))
