"""Signals that end a run in order: a checkpoint is written, and the exit code names the signal."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from thirdbody.errors import Interrupted

HANGUP = getattr(signal, "SIGHUP", None)  # not on Windows


@contextmanager
def stop_on_signal() -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C, SIGTERM and SIGHUP end a run between two compiled calls; yield a function that returns whether one came.

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
    numbers = [signal.SIGINT, signal.SIGTERM]
    if HANGUP is not None and signal.getsignal(HANGUP) != signal.SIG_IGN:
        numbers.append(HANGUP)
    before = {number: signal.signal(number, note) for number in numbers}
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
    """Let Ctrl-C end a run between two compiled calls, and a second one at once.

    Only in the main thread and with Python's default handler: a program's own handler stays in place.
    """
    caught: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        if caught:
            raise KeyboardInterrupt
        caught.append(number)

    usual = signal.default_int_handler
    ours = threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is usual
    if ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield lambda: bool(caught)
    finally:
        if ours:
            signal.signal(signal.SIGINT, usual)
    if caught:  # too late to stop anything here, but code after the run must end as well
        raise KeyboardInterrupt
