"""Signals that end a process: Ctrl-C, `kill` and `docker stop`, and a terminal that closes.

All of them raise KeyboardInterrupt, so that unfinished files are removed on the way out.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

# Windows has no SIGHUP.
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
# Time until an interrupt that was lost, or came at a wrong time, is delivered again, s.
RETRY = 0.02
# What Python says of a signal that came together with another one, whose handler made it ignored.
IGNORED = "ignored due to race condition"
# Compilers whose locks stay locked if an exception comes in the wrong place: the next compilation would never end.
LOCKING = "numba", "llvmlite"


class Interrupt(KeyboardInterrupt):
    """An interrupt by one of these signals.

    Parameters
    ----------
    number : int
        The signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


def interrupt_once(number: int, frame: FrameType | None = None) -> None:
    """Signal handler: raise `Interrupt`, and ignore further signals, which would stop the cleanup."""
    if _locks(frame):
        # This thread starts at once; a Thread would take locks of its own, which may be the interrupted ones.
        _thread.start_new_thread(_send_again, (number,))
        return
    for each in ENDING:
        signal.signal(each, signal.SIG_IGN)
    sys.unraisablehook = _deliver_again
    raise Interrupt(number)


def _locks(frame: FrameType | None) -> bool:
    """Return whether a frame, or one that called it, belongs to a library that may have locked one of its locks."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).partition(".")[0] in LOCKING:
            return True
        frame = frame.f_back
    return False


def _send_again(number: int) -> None:
    time.sleep(RETRY)
    os.kill(os.getpid(), number)


def _deliver_again(lost: sys.UnraisableHookArgs) -> None:
    """Repeat a signal whose handler raised where Python only prints errors: in destructors and callbacks."""
    if not isinstance(lost.exc_value, Interrupt):
        if IGNORED not in str(lost.exc_value):
            sys.__unraisablehook__(lost)
        return
    number, armed = lost.exc_value.number, threading.Event()

    def deliver() -> None:
        armed.wait()
        _send_again(number)

    # To start a thread may take longer than RETRY on a busy machine, and here another exception would be lost. So
    # signals are ignored until the thread runs, and the time counts from then on.
    threading.Thread(target=deliver, daemon=True).start()
    signal.signal(number, interrupt_once)
    armed.set()


@contextmanager
def raised() -> Iterator[None]:
    """Make these signals raise `Interrupt` while the block runs, unless the caller ignores or handles them."""
    usual: set[Any] = {signal.SIG_DFL}
    # Python's own handler of Ctrl-C raises once, even in a destructor, where nobody notices. Windows cannot repeat it.
    if os.name == "posix":
        usual.add(signal.default_int_handler)
    taken = [number for number in ENDING if signal.getsignal(number) in usual]
    with _handlers(dict.fromkeys(taken, interrupt_once)):
        yield


@contextmanager
def ignored() -> Iterator[None]:
    """Ignore all of these signals; processes started inside ignore them until they set their own handlers."""
    with _handlers(dict.fromkeys(ENDING, signal.SIG_IGN)):
        yield


class Postponed:
    """Postpones signals while a block runs; their handlers are called where the block says so, and at its end.

    A handler may raise between any two instructions, also where a library has just taken a lock, which stays locked, or
    started a thread, which nobody knows then. Threads that need the lock never end, and those that wait for them hang.
    """

    def __init__(self) -> None:
        self._due: deque[tuple[int, Any]] = deque()
        self._handlers: dict[int, Any] = {}

    def __enter__(self) -> Postponed:
        """Replace the handlers that are functions; only the main thread has any."""
        if threading.current_thread() is threading.main_thread():
            try:
                self._take()
            except BaseException:
                self._give_back()
                raise
        return self

    def __exit__(self, *_: object) -> None:
        """Give the handlers back, and call those whose signals have come."""
        try:
            self._give_back()
        finally:
            # Another signal may have come while some were given back.
            self._give_back()
        while self._due:
            self._call()

    def deliver(self) -> None:
        """Call the handlers whose signals have come; they may raise."""
        while self._due:
            self._give_back()
            try:
                self._call()
            finally:
                # What cleans up after an exception is not interrupted either.
                self._take()

    def _take(self) -> None:
        for number in ENDING:
            handler = signal.getsignal(number)
            if callable(handler) and handler != self._note:
                self._handlers[number] = handler
                signal.signal(number, self._note)

    def _give_back(self) -> None:
        for number, handler in self._handlers.items():
            # A handler that was called may have replaced all of them.
            if signal.getsignal(number) == self._note:
                signal.signal(number, handler)

    def _note(self, number: int, frame: Any) -> None:
        self._due.append((number, frame))

    def _call(self) -> None:
        number, frame = self._due.popleft()
        handler = signal.getsignal(number)
        if callable(handler):
            handler(number, frame)


@contextmanager
def _handlers(handlers: dict[int, Any]) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    hook = sys.unraisablehook
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        # Last, as a signal may still be waiting, of which Python would report that it is ignored.
        sys.unraisablehook = hook
