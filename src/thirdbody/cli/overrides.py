"""Values of `--set KEY=VALUE` on the command line."""

from thirdbody.errors import UsageError


def override_pairs(settings: list[str] | None) -> dict[str, str]:
    """Return the values of --set by their keys."""
    pairs = {}
    for text in settings or ():
        key, sign, value = text.partition("=")
        if not sign or not key.strip():
            raise UsageError(f"--set {text}: write KEY=VALUE, such as solver.distance='1 um'")
        pairs[key.strip()] = value.strip()
    return pairs
