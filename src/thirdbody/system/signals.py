"""Signals that end a run in order: a checkpoint is written, and the exit code names the signal."""

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from thirdbody.errors import Interrupted

HANGUP = getattr(signal, "SIGHUP", None)  # not on Windows


@contextmanager
def stop_on_signal(numbers: Iterable[int | None] = (signal.SIGINT, signal.SIGTERM, HANGUP)) -> Iterator[Callable[[], bool]]:
    """Let signals end a run between two compiled calls; yield a function that returns whether one came.

    A second Ctrl-C or SIGTERM ends at once. A hangup may arrive twice (from the kernel and from the shell), and stays ignored
    where it is ignored (`nohup`).
    """
    caught: list[int] = []

    def note(number: int, _frame: object) -> None:
        if number == HANGUP:
            # output to the closed terminal goes to the null device: writing there fails, and would end the run
            nowhere = os.open(os.devnull, os.O_RDWR)
            for terminal in terminals:
                if not os.isatty(terminal):
                    os.dup2(nowhere, terminal)
            os.close(nowhere)
        elif number in caught:
            raise KeyboardInterrupt
        caught.append(number)

    terminals = [number for number in (0, 1, 2) if os.isatty(number)]
    handled = [number for number in numbers if number and (number != HANGUP or signal.getsignal(number) != signal.SIG_IGN)]
    before = {number: signal.signal(number, note) for number in handled}
    try:
        yield lambda: bool(caught)
    except Interrupted as error:
        if caught:
            error.exit_code = 128 + caught[0]
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def stop_on_ctrl_c() -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C alone do so; only in the main thread and with Python's default handler: a program's own stays in place."""
    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with stop_on_signal((signal.SIGINT,) if usual and threading.current_thread() is threading.main_thread() else ()) as stop:
        yield stop
    if stop():  # too late to stop anything here, but code after the run must end as well
        raise KeyboardInterrupt
