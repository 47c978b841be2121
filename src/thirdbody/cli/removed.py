"""Commands and options that are gone, and what does their job now: consulted before a command line is parsed."""

from collections.abc import Iterable

from thirdbody.errors import UsageError

SEEDS = (
    "a run is computed by one process; more bodies, or a cluster, take a sweep over seeds: "
    "thirdbody sweep SCENE --vary debris.0.seed=1,2,3 (guide: On a cluster)"
)

REMOVED_COMMANDS = {"hard": "the cases that break naive codes are run by `python tests/bench/hard_cases.py` of the source tree"}

REMOVED_OPTIONS = {
    ("run", "--parts"): SEEDS,
    ("run", "--dask"): SEEDS,
    ("run", "--cluster"): SEEDS,
    ("resume", "--dask"): SEEDS,
    ("resume", "--cluster"): SEEDS,
    ("export", "--pack"): "`h5repack -f SHUF -f GZIP=4 RUN/run.vtkhdf FILE` (of the HDF5 tools) writes a compressed copy",
    ("cost", "--verify"): "closed forms and orders of convergence are checked by the project's own tests (tests/theory); what "
    "neighbouring spots do to each other is a line of `thirdbody cost SCENE --effects`, close_spots",
}


def refuse_removed_options(command: str, words: Iterable[str]) -> None:
    """Raise UsageError for the first of the words of a command line that is an option the command has lost."""
    for option in (word.partition("=")[0] for word in words):
        if (command, option) in REMOVED_OPTIONS:
            raise UsageError(f"{option}: {REMOVED_OPTIONS[command, option]}")
