"""What tells a policy that comes with the farm from a network; a file of its own, since not everyone who asks loads numpy."""

BUILTIN_MARK = b"trifarm built-in policy "
"""How the text begins that stands for the weights of such a policy; no network begins so."""
