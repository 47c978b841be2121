"""The common time step of the parts of an explicit run: the smallest of the bounds that the parts send every few steps.

All parts work at the same time, since each waits for the bounds of the others. The agreed bounds are kept in a file, so a part
that starts again from its checkpoint catches up without the others.
"""

from __future__ import annotations

import json
import secrets
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client, Connection, Listener
from pathlib import Path
from typing import Any

from thirdbody.atomic_files import write_whole
from thirdbody.engine.time_step import Bound

ADDRESS, LOG = "address.json", "bounds.jsonl"
"""Files in the folder of the parts: where the bounds are sent to; the agreed ones, a line each."""

CHECK_EVERY = 0.5
"""Wall time [s] between two looks at whether to stop, while a part waits for the others."""

HERE = "127.0.0.1"


class Bounds:
    """Collects the bounds of all parts and answers with the smallest; a context manager.

    `local`: whether the parts run on this machine.
    """

    def __init__(self, folder: Path, parts: int, local: bool) -> None:
        self.parts, self._changed = parts, threading.Condition()
        self.agreed = _read(folder / LOG)
        self.sent: dict[int, dict[int, Bound]] = {}  # by number of the agreement, then by part
        self.waiting: set[int] = set()  # parts that wait for others
        key = secrets.token_bytes(32)
        self._listener = Listener((HERE if local else "", 0), backlog=parts, authkey=key)
        self._log = _reopened(folder / LOG, self.agreed)
        machines = [HERE] if local else [_own_address(), HERE]
        address = {"machines": machines, "port": self._listener.address[1], "key": key.hex()}
        path = folder / ADDRESS
        path.touch(0o600)
        write_whole(path, json.dumps(address).encode())
        path.chmod(0o600)
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self) -> Bounds:
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()
        self._log.close()

    def _accept(self) -> None:
        while True:
            try:
                connection = self._listener.accept()
            except AuthenticationError:
                continue
            except OSError:  # it was closed
                return
            threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection: Connection) -> None:
        with suppress(OSError, EOFError, ValueError), connection:
            while True:
                message = json.loads(connection.recv_bytes())
                agreed = self._agree(message["part"], message["number"], Bound(**message["bound"]))
                connection.send_bytes(json.dumps(vars(agreed)).encode())

    def _agree(self, part: int, number: int, bound: Bound) -> Bound:
        """Return the bound of agreement `number`, once all parts have sent theirs."""
        with self._changed:
            if number == len(self.agreed):
                received = self.sent.setdefault(number, {})
                received[part] = bound
                self.waiting.add(part)
                if len(received) == self.parts:
                    self._append(_smallest([received[k] for k in sorted(received)]))
            self._changed.wait_for(lambda: number < len(self.agreed))
            return self.agreed[number]

    def _append(self, bound: Bound) -> None:
        self._log.write(json.dumps(vars(bound)) + "\n")
        self._log.flush()
        self.sent.pop(len(self.agreed))
        self.waiting.clear()
        self.agreed.append(bound)
        self._changed.notify_all()


def _smallest(bounds: list[Bound]) -> Bound:
    """Return the smallest bound, the first of equal ones."""
    best = min(bounds, key=lambda bound: bound.step)
    return replace(best, stability=min(b.stability for b in bounds), rayleigh=min(b.rayleigh for b in bounds))


def _read(path: Path) -> list[Bound]:
    """Return the bounds in a file, up to a line that a kill has cut short."""
    bounds: list[Bound] = []
    with suppress(OSError, ValueError, TypeError):
        bounds.extend(Bound(**json.loads(line)) for line in path.read_text().splitlines(keepends=True) if line.endswith("\n"))
    return bounds


def _reopened(path: Path, bounds: list[Bound]) -> Any:
    """Return the file, open behind these bounds."""
    write_whole(path, "".join(json.dumps(vars(bound)) + "\n" for bound in bounds).encode())
    return open(path, "a", encoding="utf-8")


def _own_address() -> str:
    with suppress(OSError):
        return socket.gethostbyname(socket.gethostname())
    return HERE


class CommonBound:
    """The part's side: sends the bound of a part and returns the common one. Calls `check` now and then, which may raise."""

    def __init__(self, folder: Path, part: int, check: Callable[[], None]) -> None:
        self.part, self.check = part, check
        address = json.loads((folder / ADDRESS).read_bytes())
        self._connection = _connect(address)

    def agree(self, number: int, bound: Bound) -> Bound:
        """Return the common bound of agreement `number`. Raises OSError or EOFError where nobody answers any more."""
        message = {"part": self.part, "number": number, "bound": vars(bound)}
        self._connection.send_bytes(json.dumps(message).encode())
        while not self._connection.poll(CHECK_EVERY):
            self.check()
        return Bound(**json.loads(self._connection.recv_bytes()))


def _connect(address: dict[str, Any]) -> Connection:
    """Return a connection to the first of the machines that answers. Raises OSError."""
    error: Exception = OSError("no address")
    for machine in address["machines"]:
        try:
            return Client((machine, address["port"]), authkey=bytes.fromhex(address["key"]))
        except (OSError, EOFError, AuthenticationError) as refused:
            error = refused
    raise OSError(f"nobody answers at {address['machines']}, port {address['port']}") from error
