"""Process of `local_workers`: answers pickled calls on standard input until it ends; all other output goes to standard error.

SIGTERM, or the death of the process that started it, lets `stop` return True: the call then ends with a checkpoint. The pipe
comes from that process and no other can write to it.
"""

import os
import pickle
import signal
import sys
from types import FrameType
from typing import Any


def serve(parent: int) -> None:
    """Answer calls with `(result, None)` or `(None, exception)`."""
    signals: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        signals.append(number)

    def stop() -> bool:
        return bool(signals) or os.getppid() != parent

    signal.signal(signal.SIGTERM, note)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's: the process that started this one decides
    import thirdbody.runner.simulate  # noqa: F401  (before the first call: the start is what takes long)

    replies = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    while True:
        try:
            function, arguments, options = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            reply: tuple[Any, BaseException | None] = function(*arguments, stop, **options), None
        except Exception as error:
            reply = None, error
        pickle.dump(reply, replies)
        replies.flush()


if __name__ == "__main__":
    serve(int(sys.argv[1]))
