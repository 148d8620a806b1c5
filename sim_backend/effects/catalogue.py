"""The catalogue: every effect by name, and every parameter by "effect.parameter"."""

from sim_backend.effects import actuation, body, contact, friction, looking, sensing, tracking
from sim_backend.effects.effect import Effect, Parameter

CATALOGUE: dict[str, Effect] = {
    effect.name: effect
    for module in (actuation, friction, body, contact, sensing, tracking, looking)
    for effect in module.EFFECTS
}
PARAMETERS: dict[str, Parameter] = {
    effect.key(parameter): parameter for effect in CATALOGUE.values() for parameter in effect.all_parameters
}
